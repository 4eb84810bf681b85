#include "imagery/sqlite_database.hpp"

#include <fmt/format.h>
#include <sqlite3.h>

#include <algorithm>
#include <array>
#include <mutex>
#include <utility>
#include <vector>

#include "base/error.hpp"
#include "base/printable.hpp"
#include "imagery/sqlite_input.hpp"

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

// What a database from outside may cost. Each is far above what a sound file of its size needs.
constexpr int kMaxValue_bytes = 64 << 20;  // no tile is larger; bounds what a forged length allocates
constexpr int kMaxColumns = 100;
constexpr std::int64_t kHeapLimit_bytes = std::int64_t{1} << 30;  // of all of SQLite in this process
constexpr std::uint64_t kLeastWorking_bytes = std::uint64_t{64} << 20, kMostWorking_bytes = std::uint64_t{1} << 30;
constexpr std::uint64_t kLeastResults_bytes = 1 << 20;
constexpr std::size_t kMaxQuoted_bytes = 80;  // of a name in a message
constexpr std::int64_t kLeastStep_ms = 5'000;
constexpr std::uint64_t kSlowestMedium_bytes_per_ms = 2'000;

// Sorting whole rows takes a little more than they are long.
std::uint64_t working_bytes_for(std::uint64_t size) {
  return std::min(kLeastWorking_bytes + size + size / 4, kMostWorking_bytes);
}

constexpr std::string_view kMagic("SQLite format 3\0", 16);

void check_magic(const InputFile& file) {
  std::array<std::uint8_t, kMagic.size()> head{};
  if (file.read_at(0, head) && as_text(head) == kMagic) return;
  throw Error({.what = "not an SQLite database",
               .where = file.path().string(),
               .expected = "a file that begins with \"SQLite format 3\"",
               .found = file.size() == 0 ? "an empty file" : "different bytes",
               .fix = "give an MBTiles file"});
}

// A rollback journal may end with the name of another file, which SQLite deletes when it rolls back: meant for
// transactions over several databases, which we never make. Whoever may write beside the database would choose the
// file.
void refuse_journal_that_names_a_file(const std::filesystem::path& path) {
  constexpr std::string_view kNamedFile("\xd9\xd5\x05\xf9\x20\xa1\x63\xd7", 8);
  std::error_code code;
  const std::filesystem::path journal = std::filesystem::weakly_canonical(path, code).string() + "-journal";
  if (!std::filesystem::exists(std::filesystem::symlink_status(journal, code))) return;
  const InputFile file(journal);
  std::array<std::uint8_t, kNamedFile.size()> end{};
  if (file.size() < end.size() || !file.read_at(file.size() - end.size(), end) || as_text(end) != kNamedFile) return;
  throw Error({.what = "this database's journal names another file, which would be deleted",
               .where = journal.string(),
               .expected = "the files that a killed process leaves behind",
               .found = "a journal of several databases",
               .fix = "get the folder again from its origin; nothing was changed"});
}

}  // namespace

void SqliteStatement::Finalize::operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
void SqliteDatabase::Close::operator()(sqlite3* handle) const { sqlite3_close_v2(handle); }

SqliteStatement::SqliteStatement(sqlite3_stmt* statement, const SqliteDatabase& database)
    : input_(database.input_), statement_(statement), database_(&database) {}

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

SqliteStatement& SqliteStatement::bind_real(int parameter, double value) {
  if (sqlite3_bind_double(statement_.get(), parameter, value) != SQLITE_OK) database_->fail("binding a number");
  return *this;
}

SqliteStatement& SqliteStatement::bind_real(int parameter, const std::optional<double>& value) {
  return value ? bind_real(parameter, *value) : bind_null(parameter);
}

bool SqliteStatement::step() {
  database_->begin_step();
  const int code = sqlite3_step(statement_.get());
  if (code == SQLITE_ROW) {
    database_->count_row(statement_.get());
    return true;
  }
  if (code == SQLITE_DONE) return false;
  database_->fail("running a statement");
}

void SqliteStatement::reset() {
  sqlite3_reset(statement_.get());
  database_->begin_statement();
}

bool SqliteStatement::is_null(int column) const { return sqlite3_column_type(statement_.get(), column) == SQLITE_NULL; }

std::int64_t SqliteStatement::integer(int column) const { return sqlite3_column_int64(statement_.get(), column); }

double SqliteStatement::real(int column) const { return sqlite3_column_double(statement_.get(), column); }

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
  sqlite3_limit(handle, SQLITE_LIMIT_LENGTH, kMaxValue_bytes);
}

SqliteDatabase::SqliteDatabase(InputFile file, std::uint64_t working_bytes)
    : path_(file.path()), input_(std::make_shared<const SqliteInput>(std::move(file), working_bytes)) {
  static std::once_flag once;
  std::call_once(once, [] { sqlite3_hard_heap_limit64(kHeapLimit_bytes); });
  sqlite3* handle = nullptr;
  const int code = input_->open(&handle);
  handle_.reset(handle);
  if (code != SQLITE_OK) fail("opening the database");
  sqlite3_db_config(handle, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  sqlite3_db_config(handle, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  sqlite3_db_config(handle, SQLITE_DBCONFIG_ENABLE_TRIGGER, 0, nullptr);
  sqlite3_db_config(handle, SQLITE_DBCONFIG_ENABLE_LOAD_EXTENSION, 0, nullptr);
  sqlite3_limit(handle, SQLITE_LIMIT_LENGTH, kMaxValue_bytes);
  sqlite3_limit(handle, SQLITE_LIMIT_COLUMN, kMaxColumns);
  sqlite3_limit(handle, SQLITE_LIMIT_ATTACHED, 0);
}

int SqliteDatabase::spend(void* pointer) {
  Work& work = *static_cast<Work*>(pointer);
  if (work.limit_ms > 0 && work.clock() > work.deadline_ms) {
    work.late = true;
    return 1;
  }
  return --work.left < 0 ? 1 : 0;
}

void SqliteDatabase::begin_statement() const {
  if (!work_) return;
  work_->left = work_->limit;
  work_->bytes = 0;
  begin_step();
}

void SqliteDatabase::begin_step() const {
  if (work_ && work_->limit_ms > 0) work_->deadline_ms = work_->clock() + work_->limit_ms;
}

// Pages of a forged file may belong to any number of rows.
void SqliteDatabase::count_row(sqlite3_stmt* row) const {
  if (!work_ || work_->limit_bytes == 0) return;
  for (int column = 0; column < sqlite3_column_count(row); ++column) {
    const int type = sqlite3_column_type(row, column);
    if (type == SQLITE_BLOB || type == SQLITE_TEXT) {
      work_->bytes += static_cast<std::uint64_t>(sqlite3_column_bytes(row, column));
    }
  }
  if (work_->bytes <= work_->limit_bytes) return;
  throw Error({.what = "the database gives more bytes than it has",
               .where = path_.string(),
               .expected = fmt::format("rows of at most {} bytes together", work_->limit_bytes),
               .found = "more: rows that share their bytes",
               .fix = "the file is not what it claims to be: get it from its origin"});
}

SqliteDatabase SqliteDatabase::open_immutable(const std::filesystem::path& path, SqliteSchema schema) {
  return open_immutable(InputFile(path), schema);
}

SqliteDatabase SqliteDatabase::open_immutable(InputFile file, SqliteSchema schema, MonotonicMs clock) {
  check_magic(file);
  const std::uint64_t size = file.size();
  SqliteDatabase database(std::move(file), working_bytes_for(size));
  database.limit_work(size);
  database.work_->clock = std::move(clock);
  database.work_->limit_ms = kLeastStep_ms + static_cast<std::int64_t>(size / kSlowestMedium_bytes_per_ms);
  if (schema == SqliteSchema::plain) {
    database.work_->limit_bytes = kLeastResults_bytes + size;
    database.require_plain_schema();
  }
  return database;
}

void SqliteDatabase::require_plain_schema() const {
  sqlite3_db_config(handle_.get(), SQLITE_DBCONFIG_ENABLE_VIEW, 0, nullptr);
  const auto refuse = [this](std::string_view name, std::string found) {
    throw Error({.what = "this database holds code that would run when it is read",
                 .where = fmt::format("{}, {}", path_.string(), printable(name.substr(0, kMaxQuoted_bytes))),
                 .expected = "tables and indexes only, with stored columns",
                 .found = std::move(found),
                 .fix = "the file is not what it claims to be: get it from its origin"});
  };
  std::vector<std::string> tables;
  auto schema = prepare("SELECT type, name, rootpage FROM sqlite_schema");
  while (schema.step()) {
    const std::string_view type = schema.text(0), name = schema.text(1);
    if (type == "index") continue;
    if (type != "table") refuse(name, fmt::format("a {}", printable(type.substr(0, kMaxQuoted_bytes))));
    if (schema.integer(2) == 0) refuse(name, "a virtual table");
    tables.emplace_back(name);
  }
  for (const std::string& table : tables) {
    auto columns = prepare("SELECT name, hidden FROM pragma_table_xinfo(?)");
    columns.bind(1, std::string_view(table));
    while (columns.step()) {
      if (columns.integer(1) != 0) refuse(table, fmt::format("the generated column {}", printable(columns.text(0))));
    }
  }
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
  if (std::filesystem::exists(path, code) && std::filesystem::file_size(path, code) > 0) check_magic(InputFile(path));
  refuse_journal_that_names_a_file(path);
  return {path, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, uri_of(path, "?mode=rwc")};
}

SqliteDatabase SqliteDatabase::in_memory() { return {":memory:", SQLITE_OPEN_READWRITE, "file::memory:"}; }

SqliteStatement SqliteDatabase::prepare(std::string_view sql) const& {
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

void SqliteDatabase::transaction(const std::function<void()>& work) const {
  execute("BEGIN IMMEDIATE");
  try {
    work();
    execute("COMMIT");
  } catch (...) {
    try {
      execute("ROLLBACK");
    } catch (const Error&) {  // SQLite has done it already; what went wrong first is what matters
    }
    throw;
  }
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
  if (input_ && input_->working_memory_spent()) {
    throw Error({.what = fmt::format("SQLite was stopped while {}", doing),
                 .where = path_.string(),
                 .expected = fmt::format("at most {} MB put aside for sorting",
                                         working_bytes_for(input_->file().size()) / 1'000'000),
                 .found = "a statement that needs more",
                 .fix = "the file is not what it claims to be: get it from its origin"});
  }
  if (code == SQLITE_FULL) {
    throw OutOfSpace({.what = fmt::format("SQLite failed while {}", doing),
                      .where = path_.string(),
                      .found = sqlite3_errmsg(handle_.get()),
                      .fix = "free space on this disk, or write elsewhere"});
  }
  if (code == SQLITE_INTERRUPT) {
    throw Error({.what = fmt::format("SQLite was stopped while {}", doing),
                 .where = path_.string(),
                 .expected = work_ && work_->late ? fmt::format("an answer within {} ms", work_->limit_ms)
                                                  : "no more work than a file of this size requires",
                 .found = "a view or a table that needs much more",
                 .fix = "the file is not what it claims to be: get it from its origin"});
  }
  throw Error({.what = fmt::format("SQLite failed while {}", doing),
               .where = path_.string(),
               .found = handle_ ? sqlite3_errmsg(handle_.get()) : "out of memory",
               .fix = "if the file came from elsewhere, fetch it again: it is damaged or not what it claims to be"});
}

}  // namespace nadir
