#include "upload/outbox.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <set>
#include <string>

#include "base/error.hpp"
#include "base/printable.hpp"

namespace nadir {

std::string_view name_of(TileState state) {
  switch (state) {
    case TileState::staged: return "STAGED";
    case TileState::sealed: return "SEALED";
    case TileState::announced: return "ANNOUNCED";
    case TileState::sending: return "SENDING";
    case TileState::waiting: return "WAITING";
    case TileState::sent: return "SENT";
    case TileState::parked: return "PARKED";
    case TileState::accepted: return "ACCEPTED";
    case TileState::rejected: return "REJECTED";
    case TileState::duplicate: return "DUPLICATE";
    case TileState::refused: return "REFUSED";
    case TileState::damaged: return "DAMAGED";
  }
  return {};
}

std::optional<TileState> parse_tile_state(std::string_view name) {
  for (const TileState state : kTileStates) {
    if (name_of(state) == name) return state;
  }
  return std::nullopt;
}

std::string_view outbox_statements(std::int64_t version) {
  const std::array<std::string_view, kOutboxVersion> all{outbox_sql::tables, outbox_sql::strikes, outbox_sql::damaged,
                                                         outbox_sql::installed};
  return all.at(static_cast<std::size_t>(version - 1));
}

namespace {

// Without comments and with single blanks: SQLite keeps a statement as it was written, and those may have changed.
std::string plain(std::string_view sql) {
  std::string result;
  for (std::size_t at = 0; at < sql.size(); ++at) {
    if (sql.substr(at, 2) == "--") at = std::min(sql.find('\n', at), sql.size());
    const bool blank = at >= sql.size() || sql[at] == ' ' || sql[at] == '\n';
    if (!blank) {
      result += sql[at];
    } else if (!result.empty() && result.back() != ' ') {
      result += ' ';
    }
  }
  return result;
}

[[noreturn]] void refuse(const SqliteDatabase& database, std::string expected, std::string found) {
  throw UsageError(
      {.what = "this is not an outbox as nadir sync stage creates it",
       .where = database.path().string(),
       .expected = std::move(expected),
       .found = std::move(found),
       .fix = "it was modified: stage the flight into a new outbox; tiles that have arrived are not sent twice"});
}

struct Kind {
  std::string_view name;
  std::string_view rows;  // of one text each
  bool statements;
};

// What a row says with the types that it has: 'STAGED' is another text than X'5354…'.
constexpr std::array<Kind, 3> kKinds{
    {{"tables and triggers", "SELECT sql FROM sqlite_master WHERE sql IS NOT NULL", true},
     {"states", "SELECT quote(name) || ', final ' || quote(final) FROM state", false},
     {"steps", "SELECT quote(before) || ' to ' || quote(after) FROM step", false}}};

void compare(const SqliteDatabase& database, const SqliteDatabase& ours, const Kind& kind, std::int64_t version) {
  const std::string expected = fmt::format("the {} of version {}", kind.name, version);
  const auto text = [&kind](const SqliteStatement& row) {
    return kind.statements ? plain(row.text(0)) : std::string(row.text(0));
  };
  std::set<std::string> missing;
  auto own = ours.prepare(kind.rows);
  while (own.step()) missing.insert(text(own));
  auto rows = database.prepare(kind.rows);
  while (rows.step()) {
    const std::string row = text(rows);
    if (missing.erase(row) == 0) refuse(database, expected, printable("also " + row.substr(0, 80)));
  }
  if (!missing.empty()) refuse(database, expected, "no " + missing.begin()->substr(0, 80));
}

bool is_empty(const SqliteDatabase& database) { return !database.prepare("SELECT 1 FROM sqlite_master").step(); }

void check_outbox_tables(const SqliteDatabase& database, std::int64_t version) {
  const SqliteDatabase ours = SqliteDatabase::in_memory();
  for (std::int64_t step = 1; step <= version; ++step) ours.execute(std::string(outbox_statements(step)));
  for (const Kind& kind : kKinds) compare(database, ours, kind, version);
}

namespace fs = std::filesystem;

constexpr std::int64_t kApplication = 0x4E444F42;  // "NDOB"
constexpr std::int64_t kOldestVersion = 1;

int take_lock(const fs::path& path) {
  const int lock = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0644);
  if (lock < 0) {
    throw Error({.what = "cannot write to the outbox",
                 .where = path.string(),
                 .found = system_error_text(errno),
                 .fix = "check the owner of the folder, and its disk"});
  }
  if (::flock(lock, LOCK_EX | LOCK_NB) == 0) return lock;
  ::close(lock);
  throw Error({.what = "another process is using this outbox",
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
    if (code) {
      throw Error({.what = "cannot create the outbox",
                   .where = folder.string(),
                   .found = code.message(),
                   .fix = "check the owner of the folder above it, and its disk"});
    }
  } else if (!fs::exists(file, code)) {
    throw UsageError({.what = "there is no outbox",
                      .where = folder.string(),
                      .expected = fmt::format("a folder with {}", kOutboxFile),
                      .fix = "create one: nadir sync stage"});
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
  if (access == Access::make && is_empty(*database_)) create_tables();
  const std::int64_t version = pragma(*database_, "user_version");
  const bool known = version >= kOldestVersion && version <= kOutboxVersion;
  if (pragma(*database_, "application_id") != kApplication || !known) {
    throw UsageError({.what = "this is not an outbox of this version",
                      .where = file.string(),
                      .expected = fmt::format("an outbox of version {}", kOutboxVersion),
                      .found = version > kOutboxVersion ? fmt::format("version {}", version) : "another database",
                      .fix = "use the nadir that created it, or stage the flight into a new outbox"});
  }
  check_outbox_tables(*database_, version);
  database_->execute("PRAGMA foreign_keys = ON");
  if (access == Access::read) database_->execute("PRAGMA query_only = ON");
  if (access != Access::read) database_->execute("PRAGMA synchronous = FULL");
  if (access != Access::read && version < kOutboxVersion) migrate(version);
}

// The tables come in one transaction: a kill leaves an empty file, which the next call fills.
void OutboxDatabase::create_tables() {
  database_->execute("PRAGMA auto_vacuum = INCREMENTAL");
  database_->execute("PRAGMA journal_mode = WAL");
  database_->execute("PRAGMA synchronous = FULL");
  database_->transaction([this] {
    database_->execute(fmt::format("PRAGMA application_id = {}", kApplication));
    add_versions(kOldestVersion);
  });
}

// From an older version. Readers of either see what they know.
void OutboxDatabase::migrate(std::int64_t from) {
  database_->transaction([&] { add_versions(from + 1); });
}

void OutboxDatabase::add_versions(std::int64_t first) {
  for (std::int64_t version = first; version <= kOutboxVersion; ++version) {
    database_->execute(std::string(outbox_statements(version)));
  }
  database_->execute(fmt::format("PRAGMA user_version = {}", kOutboxVersion));
}

void OutboxDatabase::transition(std::string_view name, const std::function<void()>& work) {
  database_->transaction([&] {
    work();
    if (hook_) hook_(name, false);
  });
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
