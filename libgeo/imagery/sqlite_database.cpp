#include "imagery/sqlite_database.hpp"

#include <fmt/format.h>
#include <sqlite3.h>

#include <array>
#include <fstream>
#include <utility>

#include "base/error.hpp"

namespace nadir {
namespace {

// SQLite's URIs take '?' and '#' as the end of the path and '%' as an escape.
std::string uri_of(const std::filesystem::path& path, std::string_view query) {
  std::string uri = "file:";
  for (const char c : std::filesystem::absolute(path).string()) {
    if (c == '?' || c == '#' || c == '%') {
      uri += fmt::format("%{:02X}", static_cast<unsigned>(c));
    } else {
      uri += c;
    }
  }
  return uri.append(query);
}

void check_magic(const std::filesystem::path& path) {
  std::error_code code;
  const auto status = std::filesystem::status(path, code);
  if (!std::filesystem::exists(status)) {
    throw Error({.what = "the tile set does not exist", .where = path.string(), .fix = "check the path"});
  }
  if (!std::filesystem::is_regular_file(status)) {
    throw Error({.what = "the tile set is not a file", .where = path.string(), .expected = "an SQLite file"});
  }
  std::array<char, 16> head{};
  std::ifstream file(path, std::ios::binary);
  file.read(head.data(), head.size());
  if (file.gcount() != 16 || std::string_view(head.data(), 16) != std::string_view("SQLite format 3\0", 16)) {
    throw Error({.what = "not an SQLite database",
                 .where = path.string(),
                 .expected = "a file that begins with \"SQLite format 3\"",
                 .found = file.gcount() == 0 ? "an unreadable or empty file" : "different bytes",
                 .fix = "give an MBTiles file"});
  }
}

// A rollback journal may end with the name of another file, which SQLite deletes when it rolls back: meant for
// transactions over several databases, which we never make. Whoever may write beside the database would choose the
// file.
void refuse_journal_that_names_a_file(const std::filesystem::path& path) {
  constexpr std::string_view kMagic("\xd9\xd5\x05\xf9\x20\xa1\x63\xd7", 8);
  std::error_code code;
  const std::filesystem::path journal = std::filesystem::weakly_canonical(path, code).string() + "-journal";
  std::ifstream file(journal, std::ios::binary);
  std::array<char, kMagic.size()> end{};
  file.seekg(-static_cast<std::streamoff>(end.size()), std::ios::end).read(end.data(), end.size());
  if (!file || std::string_view(end.data(), end.size()) != kMagic) return;
  throw Error({.what = "this database's journal names another file, which would be deleted",
               .where = journal.string(),
               .expected = "the files that a killed process leaves behind",
               .found = "a journal of several databases",
               .fix = "get the folder again from its origin; nothing was changed"});
}

}  // namespace

void SqliteStatement::Finalize::operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
void SqliteDatabase::Close::operator()(sqlite3* handle) const { sqlite3_close_v2(handle); }

SqliteStatement& SqliteStatement::bind(int parameter, std::int64_t value) {
  if (sqlite3_bind_int64(statement_.get(), parameter, value) != SQLITE_OK) database_->fail("binding an integer");
  return *this;
}

SqliteStatement& SqliteStatement::bind(int parameter, std::string_view text) {
  if (sqlite3_bind_text64(statement_.get(), parameter, text.data(), text.size(), SQLITE_TRANSIENT, SQLITE_UTF8) !=
      SQLITE_OK) {
    database_->fail("binding text");
  }
  return *this;
}

SqliteStatement& SqliteStatement::bind(int parameter, ByteView blob) {
  if (sqlite3_bind_blob64(statement_.get(), parameter, blob.data(), blob.size(), SQLITE_STATIC) != SQLITE_OK) {
    database_->fail("binding bytes");
  }
  return *this;
}

SqliteStatement& SqliteStatement::bind_null(int parameter) {
  if (sqlite3_bind_null(statement_.get(), parameter) != SQLITE_OK) database_->fail("binding null");
  return *this;
}

bool SqliteStatement::step() {
  const int code = sqlite3_step(statement_.get());
  if (code == SQLITE_ROW) return true;
  if (code == SQLITE_DONE) return false;
  database_->fail("running a statement");
}

void SqliteStatement::reset() {
  sqlite3_reset(statement_.get());
  database_->begin_statement();
}

bool SqliteStatement::is_null(int column) const { return sqlite3_column_type(statement_.get(), column) == SQLITE_NULL; }

std::int64_t SqliteStatement::integer(int column) const { return sqlite3_column_int64(statement_.get(), column); }

std::string_view SqliteStatement::text(int column) const {
  const unsigned char* text = sqlite3_column_text(statement_.get(), column);
  if (text == nullptr) return {};
  return {reinterpret_cast<const char*>(text),
          static_cast<std::size_t>(sqlite3_column_bytes(statement_.get(), column))};
}

ByteView SqliteStatement::blob(int column) const {
  const void* data = sqlite3_column_blob(statement_.get(), column);
  if (data == nullptr) return {};
  return {static_cast<const std::uint8_t*>(data),
          static_cast<std::size_t>(sqlite3_column_bytes(statement_.get(), column))};
}

SqliteDatabase::SqliteDatabase(std::filesystem::path path, int flags, const std::string& uri) : path_(std::move(path)) {
  sqlite3* handle = nullptr;
  const int code = sqlite3_open_v2(uri.c_str(), &handle, flags | SQLITE_OPEN_URI, nullptr);
  handle_.reset(handle);
  if (code != SQLITE_OK) fail("opening the database");
  sqlite3_db_config(handle, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  sqlite3_db_config(handle, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  sqlite3_limit(handle, SQLITE_LIMIT_LENGTH, 64 << 20);  // no tile is larger; bounds what a forged length allocates
}

int SqliteDatabase::spend(void* work) { return --static_cast<Work*>(work)->left < 0 ? 1 : 0; }

void SqliteDatabase::begin_statement() const {
  if (work_) work_->left = work_->limit;
}

SqliteDatabase SqliteDatabase::open_immutable(const std::filesystem::path& path) {
  check_magic(path);
  SqliteDatabase database(path, SQLITE_OPEN_READONLY, uri_of(path, "?mode=ro&immutable=1"));
  database.limit_work(std::filesystem::file_size(path));
  return database;
}

void SqliteDatabase::limit_work(std::uint64_t bytes) {
  if (!work_) {
    work_ = std::make_unique<Work>();
    sqlite3_progress_handler(handle_.get(), 1'000, &SqliteDatabase::spend, work_.get());
  }
  // A row of the smallest kind takes some ten bytes and, sorted and checked, less than a hundred instructions.
  work_->limit = 300 + static_cast<std::int64_t>(bytes / 100);
  begin_statement();
}

SqliteDatabase SqliteDatabase::create(const std::filesystem::path& path) {
  if (std::filesystem::exists(path)) {
    throw Error({.what = "the file exists already", .where = path.string(), .fix = "choose another name"});
  }
  return {path, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, uri_of(path, "?mode=rwc")};
}

SqliteDatabase SqliteDatabase::open_writable(const std::filesystem::path& path) {
  std::error_code code;
  if (std::filesystem::exists(path, code) && std::filesystem::file_size(path, code) > 0) check_magic(path);
  refuse_journal_that_names_a_file(path);
  return {path, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, uri_of(path, "?mode=rwc")};
}

SqliteDatabase SqliteDatabase::in_memory() { return {":memory:", SQLITE_OPEN_READWRITE, "file::memory:"}; }

SqliteStatement SqliteDatabase::prepare(std::string_view sql) const {
  begin_statement();
  sqlite3_stmt* statement = nullptr;
  if (sqlite3_prepare_v3(handle_.get(), sql.data(), static_cast<int>(sql.size()), SQLITE_PREPARE_PERSISTENT, &statement,
                         nullptr) != SQLITE_OK) {
    fail("preparing a statement");
  }
  return {statement, *this};
}

void SqliteDatabase::execute(const std::string& sql) const {
  begin_statement();
  if (sqlite3_exec(handle_.get(), sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK) fail("running a statement");
}

bool SqliteDatabase::has_table(std::string_view name) const {
  auto found = prepare("SELECT 1 FROM sqlite_master WHERE type IN ('table', 'view') AND name = ?");
  return found.bind(1, name).step();
}

void SqliteDatabase::close() {
  if (sqlite3_close(handle_.get()) != SQLITE_OK) fail("closing the database");
  [[maybe_unused]] sqlite3* const closed = handle_.release();
}

void SqliteDatabase::fail(const char* doing) const {
  const int code = handle_ ? sqlite3_errcode(handle_.get()) : SQLITE_NOMEM;
  if (code == SQLITE_FULL) {
    throw OutOfSpace({.what = fmt::format("SQLite failed while {}", doing),
                      .where = path_.string(),
                      .found = sqlite3_errmsg(handle_.get()),
                      .fix = "free space on this disk, or write elsewhere"});
  }
  if (code == SQLITE_INTERRUPT) {
    throw Error({.what = fmt::format("SQLite was stopped while {}", doing),
                 .where = path_.string(),
                 .expected = "no more work than a file of this size requires",
                 .found = "a view or trigger that needs much more",
                 .fix = "the file is not what it claims to be: get it from its origin"});
  }
  throw Error({.what = fmt::format("SQLite failed while {}", doing),
               .where = path_.string(),
               .found = handle_ ? sqlite3_errmsg(handle_.get()) : "out of memory",
               .fix = "if the file came from elsewhere, fetch it again: it is damaged or not what it claims to be"});
}

}  // namespace nadir
