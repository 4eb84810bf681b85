#include "upload/outbox_database.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>

#include "base/error.hpp"
#include "upload/outbox_check.hpp"
#include "upload/outbox_tables.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kApplication = 0x4E444F42;  // "NDOB"
constexpr std::int64_t kOldestVersion = 1;

int take_lock(const fs::path& path) {
  const int lock = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (lock < 0) {
    throw Error({.what = "cannot use the outbox", .where = path.string(), .found = system_error_text(errno)});
  }
  if (::flock(lock, LOCK_EX | LOCK_NB) == 0) return lock;
  ::close(lock);
  throw Error({.what = "another program works on this outbox",
               .where = path.parent_path().string(),
               .fix = "wait for the other nadir sync, or end it: what it has done is kept"});
}

// Of all rows that are there; the log holds those that have not come into the file yet.
std::uint64_t bytes_on_disk(const fs::path& file) {
  std::uint64_t bytes = 0;
  for (const fs::path& part : {file, fs::path(file.string() + "-wal")}) {
    std::error_code code;
    const std::uintmax_t size = fs::file_size(part, code);
    if (!code) bytes += size;
  }
  return bytes;
}

std::int64_t pragma(const SqliteDatabase& database, const char* name) {
  auto statement = database.prepare(fmt::format("PRAGMA {}", name));
  return statement.step() ? statement.integer(0) : 0;
}

}  // namespace

OutboxDatabase::OutboxDatabase(const fs::path& folder, Access access, TransitionHook hook) : hook_(std::move(hook)) {
  const fs::path file = folder / kOutboxFile;
  std::error_code code;
  if (access == Access::make) {
    fs::create_directories(folder, code);
    if (code) throw Error({.what = "cannot make the outbox", .where = folder.string(), .found = code.message()});
  } else if (!fs::exists(file, code)) {
    throw UsageError({.what = "there is no outbox",
                      .where = folder.string(),
                      .expected = fmt::format("a folder with {}", kOutboxFile),
                      .fix = "nadir sync stage makes one"});
  }
  if (access != Access::read) lock_ = take_lock(folder / "lock");
  try {
    open(file, access);
  } catch (...) {
    if (lock_ >= 0) ::close(lock_);
    throw;
  }
}

OutboxDatabase::~OutboxDatabase() {
  database_.reset();
  if (lock_ >= 0) ::close(lock_);
}

void OutboxDatabase::open(const fs::path& file, Access access) {
  database_ = std::make_unique<SqliteDatabase>(SqliteDatabase::open_writable(file));
  database_->limit_work(bytes_on_disk(file));
  database_->execute("PRAGMA busy_timeout = 10000");
  if (access == Access::make && is_empty(*database_)) lay_out();
  const std::int64_t version = pragma(*database_, "user_version");
  const bool known = version >= kOldestVersion && version <= kOutboxVersion;
  if (pragma(*database_, "application_id") != kApplication || !known) {
    throw UsageError({.what = "not an outbox of this version",
                      .where = file.string(),
                      .expected = fmt::format("an outbox of version {}", kOutboxVersion),
                      .found = version > kOutboxVersion ? fmt::format("version {}", version) : "another database"});
  }
  check_outbox_tables(*database_, version);
  database_->execute("PRAGMA foreign_keys = ON");
  if (access == Access::read) database_->execute("PRAGMA query_only = ON");
  if (access != Access::read) database_->execute("PRAGMA synchronous = FULL");
  if (access != Access::read && version < kOutboxVersion) bring_up_to_date(version);
}

// The tables come in one transaction: a kill leaves an empty file, which the next call fills.
void OutboxDatabase::lay_out() {
  database_->execute("PRAGMA auto_vacuum = INCREMENTAL");
  database_->execute("PRAGMA journal_mode = WAL");
  database_->execute("PRAGMA synchronous = FULL");
  database_->execute("BEGIN IMMEDIATE");
  database_->execute(fmt::format("PRAGMA application_id = {}", kApplication));
  add_versions(kOldestVersion);
  database_->execute("COMMIT");
}

// From an older version. Readers of either see what they know.
void OutboxDatabase::bring_up_to_date(std::int64_t from) {
  database_->execute("BEGIN IMMEDIATE");
  add_versions(from + 1);
  database_->execute("COMMIT");
}

void OutboxDatabase::add_versions(std::int64_t first) {
  for (std::int64_t version = first; version <= kOutboxVersion; ++version) {
    database_->execute(std::string(outbox_statements(version)));
  }
  database_->execute(fmt::format("PRAGMA user_version = {}", kOutboxVersion));
}

void OutboxDatabase::transition(std::string_view name, const std::function<void()>& work) {
  database_->execute("BEGIN IMMEDIATE");
  try {
    work();
    if (hook_) hook_(name, false);
    database_->execute("COMMIT");
  } catch (...) {
    try {
      database_->execute("ROLLBACK");
    } catch (const Error&) {  // SQLite has done it already; what went wrong first is what matters
    }
    throw;
  }
  database_->limit_work(bytes_on_disk(database_->path()));  // it may have grown
  if (hook_) hook_(name, true);
}

std::int64_t OutboxDatabase::move_tiles(std::int64_t batch, TileState before, TileState after, std::int64_t now_ms) {
  auto update = prepare("UPDATE tile SET state = ?, changed_ms = ? WHERE batch = ? AND state = ?");
  update.bind(1, name_of(after)).bind(2, now_ms).bind(3, batch).bind(4, name_of(before)).run();
  return changes();
}

std::int64_t OutboxDatabase::changes() const {
  auto count = prepare("SELECT changes()");
  count.step();
  return count.integer(0);
}

void OutboxDatabase::shrink() {
  auto vacuum = prepare("PRAGMA incremental_vacuum");
  while (vacuum.step()) {
  }
  vacuum.reset();
  database_->execute("PRAGMA wal_checkpoint(TRUNCATE)");
}

}  // namespace nadir
