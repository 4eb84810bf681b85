// Databases from somebody who wants to do harm: code in the schema, files that are exchanged, work without end.
#include "imagery/sqlite_input.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "imagery/sqlite_database.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr const char* kTwoRows =
    "CREATE TABLE tiles (zoom_level INTEGER, tile_data BLOB); INSERT INTO tiles VALUES (1, x'0102'), (2, x'03');";

class SqliteInputs : public ::testing::Test {
 protected:
  fs::path make(std::string_view name, const std::string& sql) {
    SqliteDatabase database = SqliteDatabase::create(folder_ / name);
    database.execute(sql);
    database.close();
    return folder_ / name;
  }
  static SqliteDatabase plain(const fs::path& path) {
    return SqliteDatabase::open_immutable(path, SqliteSchema::plain);
  }
  static ErrorText refusal_of(const std::function<void()>& work) {
    try {
      work();
    } catch (const Error& error) {
      return error.text();
    }
    ADD_FAILURE() << "not refused";
    return {.what = ""};
  }
  test::TemporaryFolder folder_;
};

TEST_F(SqliteInputs, APlainSchemaIsRead) {
  const SqliteDatabase database =
      plain(make("good", std::string(kTwoRows) + "CREATE UNIQUE INDEX i ON tiles (zoom_level);"));
  auto rows = database.prepare("SELECT zoom_level, tile_data FROM tiles ORDER BY zoom_level DESC");
  ASSERT_TRUE(rows.step());
  EXPECT_EQ(rows.integer(0), 2);
  EXPECT_EQ(rows.blob(1).size(), 1U);
  ASSERT_TRUE(rows.step());
  EXPECT_FALSE(rows.step());
  EXPECT_THROW(database.execute("INSERT INTO tiles VALUES (3, NULL)"), Error);
}

// Two gigabytes of temporary files in four seconds, before any signature covered a byte of it.
TEST_F(SqliteInputs, CodeInTheSchemaIsRefusedBeforeItRuns) {
  const struct {
    const char* sql;
    const char* found;
  } attacks[] = {
      {"CREATE VIEW nadir_sidecars AS WITH RECURSIVE n(x) AS (SELECT 0 UNION ALL SELECT x + 1 FROM n LIMIT 70)"
       " SELECT zeroblob(30000000) AS mask, x FROM n ORDER BY mask",
       "a view"},
      {"CREATE TRIGGER t AFTER INSERT ON tiles BEGIN DELETE FROM tiles; END", "a trigger"},
      {"CREATE VIRTUAL TABLE s USING fts5(text)", "a virtual table"},
      {"CREATE TABLE more (a, b BLOB GENERATED ALWAYS AS (zeroblob(30000000)) VIRTUAL)", "the generated column b"},
      {"CREATE TABLE more (a, b BLOB GENERATED ALWAYS AS (zeroblob(3)) STORED)", "the generated column b"},
  };
  int number = 0;
  for (const auto& attack : attacks) {
    const fs::path file = make("attack" + std::to_string(number++), std::string(kTwoRows) + attack.sql);
    const ErrorText refused = refusal_of([&] { plain(file); });
    EXPECT_EQ(refused.what, "this database holds code that would run when it is read") << attack.sql;
    EXPECT_EQ(refused.found, attack.found);
    EXPECT_NO_THROW(SqliteDatabase::open_immutable(file)) << "other programs' files may have it";
  }
}

// Where views are allowed, what they put aside is bounded and stays in memory.
TEST_F(SqliteInputs, SortingPutsAsideNoMoreThanTheLimit) {
  const fs::path file =
      make("view", std::string(kTwoRows) +
                       "CREATE VIEW big AS WITH RECURSIVE n(x) AS (SELECT 0 UNION ALL SELECT x + 1 FROM n"
                       " LIMIT 70) SELECT zeroblob(30000000 + x) AS mask, x FROM n");
  const SqliteDatabase database = SqliteDatabase::open_immutable(file);
  auto rows = database.prepare("SELECT mask FROM big ORDER BY mask, x DESC");
  const ErrorText refused = refusal_of([&] {
    while (rows.step()) {
    }
  });
  EXPECT_NE(refused.expected.find("put aside for sorting"), std::string::npos) << refused.expected;
}

TEST_F(SqliteInputs, ASortThatFitsIsDoneInMemory) {
  const fs::path file = make("sort",
                             "CREATE TABLE t (a, b BLOB); WITH RECURSIVE n(x) AS (SELECT 0 UNION ALL SELECT x + 1"
                             " FROM n LIMIT 20000) INSERT INTO t SELECT (x * 7919) % 20011, randomblob(900) FROM n");
  const SqliteDatabase database = plain(file);
  auto rows = database.prepare("SELECT a, b FROM t ORDER BY a");
  std::int64_t last = -1, count = 0;
  while (rows.step()) {
    EXPECT_LT(last, rows.integer(0));
    last = rows.integer(0);
    ++count;
  }
  EXPECT_EQ(count, 20'000);
}

TEST_F(SqliteInputs, AFileThatIsExchangedWhileItIsOpenStaysTheOneThatWasOpened) {
  const fs::path file = make("tiles", kTwoRows);
  make("other", "CREATE TABLE tiles (zoom_level INTEGER, tile_data BLOB); INSERT INTO tiles VALUES (9, x'ff');");
  const InputFile opened(file);
  fs::rename(folder_ / "other", file);
  const SqliteDatabase database = SqliteDatabase::open_immutable(opened.duplicate(), SqliteSchema::plain);
  auto rows = database.prepare("SELECT min(zoom_level) FROM tiles");
  ASSERT_TRUE(rows.step());
  EXPECT_EQ(rows.integer(0), 1);
}

TEST_F(SqliteInputs, AJournalBesideTheFileIsNotLookedFor) {
  const fs::path file = make("tiles", kTwoRows);
  folder_.write("tiles-journal", "not a journal");
  folder_.write("tiles-wal", "not a log");
  const SqliteDatabase database = plain(file);
  auto rows = database.prepare("SELECT count(*) FROM tiles");
  ASSERT_TRUE(rows.step());
  EXPECT_EQ(rows.integer(0), 2);
}

TEST_F(SqliteInputs, AStepThatTakesTooLongIsStopped) {
  const fs::path file = make("slow", kTwoRows);
  std::int64_t now_ms = 0;
  const SqliteDatabase database =
      SqliteDatabase::open_immutable(InputFile(file), SqliteSchema::plain, [&now_ms] { return now_ms += 1'000; });
  auto rows = database.prepare(
      "WITH RECURSIVE n(x) AS (SELECT 0 UNION ALL SELECT x + 1 FROM n LIMIT 100000)"
      " SELECT count(*) FROM n");
  const ErrorText refused = refusal_of([&] { rows.step(); });
  EXPECT_EQ(refused.expected, "an answer within 5004 ms");
}

// Pages of a forged file can belong to many rows at once; a join stands for it.
TEST_F(SqliteInputs, RowsCannotBeMoreThanTheFile) {
  const fs::path file = make("shared",
                             "CREATE TABLE t (b BLOB); WITH RECURSIVE n(x) AS (SELECT 0 UNION ALL SELECT x + 1"
                             " FROM n LIMIT 300) INSERT INTO t SELECT zeroblob(4000) FROM n");
  const SqliteDatabase database = plain(file);
  auto once = database.prepare("SELECT b FROM t");
  int count = 0;
  while (once.step()) ++count;
  EXPECT_EQ(count, 300);
  auto many = database.prepare("SELECT one.b FROM t AS one, t AS other");
  const ErrorText refused = refusal_of([&] {
    while (many.step()) {
    }
  });
  EXPECT_EQ(refused.what, "the database gives more bytes than it has");
}

TEST_F(SqliteInputs, AFileThatIsCutWhileItIsReadIsAnError) {
  const fs::path file = make("cut",
                             "CREATE TABLE t (b BLOB); WITH RECURSIVE n(x) AS (SELECT 0 UNION ALL SELECT x + 1"
                             " FROM n LIMIT 300) INSERT INTO t SELECT randomblob(4000) FROM n");
  const SqliteDatabase database = plain(file);
  fs::resize_file(file, 8192);
  auto rows = database.prepare("SELECT b FROM t");
  EXPECT_THROW(
      {
        while (rows.step()) {
        }
      },
      Error);
}

}  // namespace
}  // namespace nadir
