// Outboxes that an attacker or a disk has damaged.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "upload/outbox_fixture.hpp"
#include "upload/outbox_upkeep.hpp"

namespace nadir {
namespace {

using Access = OutboxDatabase::Access;

using OutboxAbuse = test::OutboxFixture;

// SQLite's super-journal: of a transaction over several databases, deleted when it is rolled back.
TEST_F(OutboxAbuse, AJournalThatNamesAnotherFileDeletesNothing) {
  outbox_.reset();
  const std::filesystem::path victim = folder_ / "precious";
  write_file_atomic(victim, "precious");
  const auto big_endian = [](std::uint32_t value) {
    std::string bytes;
    for (const int shift : {24, 16, 8, 0}) bytes += static_cast<char>(value >> shift & 0xFF);
    return bytes;
  };
  const std::string magic = "\xd9\xd5\x05\xf9\x20\xa1\x63\xd7", name = victim.string();
  const auto pages = static_cast<std::uint32_t>(std::filesystem::file_size(file_) / 4096);
  std::string journal = magic + big_endian(0) + big_endian(0) + big_endian(pages) + big_endian(512) + big_endian(4096);
  journal.resize(512);
  std::uint32_t sum = 0;
  for (const char c : name) sum += static_cast<std::uint32_t>(c);
  journal += big_endian((1U << 30) / 4096 + 1) + name + big_endian(static_cast<std::uint32_t>(name.size())) +
             big_endian(sum) + magic;
  write_file_atomic(file_.string() + "-journal", journal);
  for (const Access access : {Access::read, Access::write, Access::make}) {
    EXPECT_THROW(OutboxDatabase(folder_ / "outbox", access), Error);
  }
  EXPECT_EQ(read_text_file(victim), "precious");
  journal.resize(512);  // one that a killed program leaves
  write_file_atomic(file_.string() + "-journal", journal);
  EXPECT_NO_THROW(OutboxDatabase(folder_ / "outbox", Access::read));
}

TEST_F(OutboxAbuse, RejectsOtherTablesOrConstraints) {
  stage(2);
  int number = 0;
  for (const char* sql :
       {"DROP TRIGGER blob_stays", "CREATE TABLE more (a)", "CREATE VIEW more AS SELECT 1",
        "CREATE TRIGGER more AFTER UPDATE ON tile BEGIN DELETE FROM document; END", "DROP INDEX tile_by_pack",
        "DROP TRIGGER blob_stays; CREATE TRIGGER blob_stays BEFORE DELETE ON blob WHEN 0 BEGIN SELECT 1; END",
        "UPDATE state SET final = 1 WHERE name = 'SENT'", "UPDATE state SET final = 0.5 WHERE name = 'SENT'",
        "DELETE FROM state WHERE name = 'SENT'", "UPDATE state SET name = CAST(name AS BLOB)",
        "INSERT INTO state VALUES ('STRANGE', 1)", "ALTER TABLE tile ADD COLUMN path TEXT"}) {
    SCOPED_TRACE(sql);
    outbox_.reset();
    const std::filesystem::path other = folder_ / std::to_string(++number);
    std::filesystem::create_directory(other);
    std::filesystem::copy_file(file_, other / kOutboxFile);
    SqliteDatabase::open_writable(other / kOutboxFile).execute(sql);
    for (const Access access : {Access::read, Access::write, Access::make}) {
      EXPECT_THROW(OutboxDatabase(other, access), UsageError);
    }
  }
  EXPECT_NO_THROW(reopen());
}

// What the triggers go by is a table: with another row, a tile goes another way.
TEST_F(OutboxAbuse, RejectsUnexpectedStateTransitionsAndNamesThem) {
  stage(1);
  int number = 0;
  for (const auto& [sql, named] : std::initializer_list<std::pair<const char*, const char*>>{
           {"INSERT INTO step VALUES ('STAGED', 'ACCEPTED')", "also 'STAGED' to 'ACCEPTED'"},
           {"INSERT INTO step VALUES (X'00', 'SENT')", "also X'00' to 'SENT'"},
           {"DELETE FROM step WHERE before = 'WAITING' AND after = 'PARKED'", "no 'WAITING' to 'PARKED'"},
           {"DELETE FROM step", "no "},
           {"UPDATE step SET after = 'REFUSED' WHERE before = 'SENT' AND after = 'ACCEPTED'",
            "also 'SENT' to 'REFUSED'"},
           {"UPDATE step SET before = CAST(before AS BLOB) WHERE before = 'SEALED'", "also X'5345414C4544' to '"},
           {"INSERT INTO step VALUES (1, hex(zeroblob(100000)))", "also '1' to '0000"}}) {
    SCOPED_TRACE(sql);
    outbox_.reset();
    const std::filesystem::path other = folder_ / ("steps" + std::to_string(++number));
    std::filesystem::create_directory(other);
    std::filesystem::copy_file(file_, other / kOutboxFile);
    SqliteDatabase::open_writable(other / kOutboxFile).execute(sql);
    for (const Access access : {Access::read, Access::write, Access::make}) {
      try {
        OutboxDatabase(other, access);
        ADD_FAILURE() << "it was opened";
      } catch (const UsageError& error) {
        EXPECT_THAT(error.text().expected, ::testing::StartsWith("the steps of version "));
        EXPECT_THAT(error.text().found, ::testing::StartsWith(named));
        EXPECT_LT(error.text().found.size(), 120U);
      }
    }
  }
}

TEST_F(OutboxAbuse, DoesNotCreateTablesInAForeignDatabase) {
  const std::filesystem::path other = folder_ / "foreign";
  std::filesystem::create_directory(other);
  SqliteDatabase::create(other / kOutboxFile).execute("CREATE TABLE letters (a)");
  EXPECT_THROW(OutboxDatabase(other, Access::make), UsageError);
  EXPECT_FALSE(SqliteDatabase::open_writable(other / kOutboxFile).has_table("tile"));
}

TEST_F(OutboxAbuse, ReportsAnImpossibleStateOrTime) {
  stage(1);
  seal();
  change("UPDATE tile SET state = 'NOWHERE'");
  reopen();
  EXPECT_THROW(report_outbox(*outbox_), Error) << "it is not as if every tile had its verdict";
  for (const char* time : {"-1", "9223372036854775807"}) {
    change(std::string("UPDATE tile SET state = 'SEALED'; UPDATE batch SET not_before_ms = ") + time);
    reopen();
    EXPECT_THROW(report_outbox(*outbox_), Error) << time;
  }
}

TEST_F(OutboxAbuse, DoesNotSendAPackWhoseSizeDiffersFromItsRow) {
  stage(1);
  seal();
  transfer_.announced(*transfer_.next_batch(0), answer({0}, {}, {}), 5);
  change("UPDATE pack SET size = size + 1000000");
  reopen();
  EXPECT_THROW(transfer_.pack_bytes(*transfer_.next_pack(*transfer_.next_batch(0))), Error);
}

}  // namespace
}  // namespace nadir
