#include "flights/flight_database.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <set>
#include <string>
#include <utility>

#include "base/error.hpp"
#include "base/printable.hpp"
#include "imagery/sqlite_database.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kApplication = 0x4E44464C;  // "NDFL"
constexpr const char* kLockFile = "lock";

// SQLite keeps each statement as it stands here, and opening compares them: a changed blank is another version.
// Columns in units of their names; lat_deg and lon_deg WGS 84; times in milliseconds since 1970, UTC.
constexpr std::int64_t kOldestVersion = 3;
constexpr std::array kTablesOfVersion3{
    "CREATE TABLE flight (id INTEGER PRIMARY KEY CHECK (id = 1), name TEXT NOT NULL, package TEXT NOT NULL, "
    "camera TEXT NOT NULL, start_lat_deg REAL, start_lon_deg REAL, created_ms INTEGER NOT NULL, "
    "outside TEXT, session BLOB NOT NULL) STRICT",

    "CREATE TABLE picture (id INTEGER PRIMARY KEY AUTOINCREMENT, frame INTEGER UNIQUE, name TEXT NOT NULL, "
    "file TEXT NOT NULL, sha256 BLOB, bytes INTEGER, width INTEGER, height INTEGER, time_s REAL, telemetry BLOB, "
    "state TEXT NOT NULL CHECK (state IN ('accepted', 'processed', 'refused')), reason TEXT NOT NULL, "
    "CHECK ((state = 'refused') = (frame IS NULL))) STRICT",
    "CREATE UNIQUE INDEX picture_by_name ON picture (name) WHERE frame IS NOT NULL",
    "CREATE INDEX picture_by_sha256 ON picture (sha256) WHERE frame IS NOT NULL",

    "CREATE TABLE measurement (frame INTEGER PRIMARY KEY REFERENCES picture (frame), answers BLOB NOT NULL) STRICT",
    "CREATE TABLE look (frame INTEGER PRIMARY KEY REFERENCES picture (frame), seen BLOB NOT NULL, "
    "map BLOB NOT NULL) STRICT",

    "CREATE TABLE estimate (frame INTEGER NOT NULL REFERENCES picture (frame), "
    "kind TEXT NOT NULL CHECK (kind IN ('online', 'refined', 'adjusted', 'placed')), lat_deg REAL, lon_deg REAL, "
    "sigma_m REAL, cov_ee_m2 REAL, cov_en_m2 REAL, cov_nn_m2 REAL, hpl_m REAL, source TEXT NOT NULL, "
    "segment INTEGER NOT NULL, verdict TEXT NOT NULL, latency_ms REAL, record BLOB NOT NULL, anchor BLOB, "
    "PRIMARY KEY (frame, kind)) STRICT",

    "CREATE TABLE segment (segment INTEGER PRIMARY KEY, first_frame INTEGER NOT NULL, last_frame INTEGER NOT NULL, "
    "state TEXT NOT NULL CHECK (state IN ('floating', 'anchored', 'merged')), anchored_frame INTEGER) STRICT",

    "CREATE TABLE fix (id INTEGER PRIMARY KEY AUTOINCREMENT, before_frame INTEGER NOT NULL, lat_deg REAL NOT NULL, "
    "lon_deg REAL NOT NULL, radius_m REAL NOT NULL, author TEXT NOT NULL, time_ms INTEGER NOT NULL, frame INTEGER, "
    "pixel_x REAL, pixel_y REAL, sigma_m REAL NOT NULL, hint_lat_deg REAL NOT NULL, hint_lon_deg REAL NOT NULL, "
    "hint_radius_m REAL NOT NULL, withdrawn_ms INTEGER, withdrawn_from INTEGER) STRICT",

    "CREATE TABLE object (id INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL, author TEXT NOT NULL, "
    "time_ms INTEGER NOT NULL) STRICT",
    "CREATE TABLE sighting (id INTEGER PRIMARY KEY AUTOINCREMENT, object INTEGER NOT NULL REFERENCES object (id), "
    "frame INTEGER NOT NULL, pixel_x REAL NOT NULL, pixel_y REAL NOT NULL) STRICT",
    "CREATE INDEX sighting_by_object ON sighting (object)",

    "CREATE TABLE event (id INTEGER PRIMARY KEY AUTOINCREMENT, time_ms INTEGER NOT NULL, kind TEXT NOT NULL, "
    "frame INTEGER, body TEXT NOT NULL) STRICT"};

constexpr std::array kTablesOfVersion4{
    "CREATE TABLE lens (id INTEGER PRIMARY KEY CHECK (id = 1), log_focal REAL NOT NULL, k1 REAL NOT NULL, "
    "k2 REAL NOT NULL, p1 REAL NOT NULL, p2 REAL NOT NULL, k3 REAL NOT NULL) STRICT",
    "CREATE TABLE pose (frame INTEGER PRIMARY KEY REFERENCES picture (frame), heading_deg REAL NOT NULL, "
    "pitch_deg REAL NOT NULL, roll_deg REAL NOT NULL, agl_m REAL NOT NULL) STRICT",
    "CREATE TABLE pose_covariance (frame INTEGER NOT NULL, other INTEGER NOT NULL, covariance BLOB NOT NULL, "
    "PRIMARY KEY (frame, other)) STRICT, WITHOUT ROWID",

    "CREATE TABLE merge_basis (segment INTEGER NOT NULL REFERENCES segment (segment), basis INTEGER NOT NULL "
    "REFERENCES segment (segment), PRIMARY KEY (segment, basis)) STRICT, WITHOUT ROWID"};

int take_lock(const fs::path& folder) {
  const fs::path path = folder / kLockFile;
  const int lock = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0644);
  if (lock < 0) {
    throw Error({.what = "cannot write to the flight",
                 .where = path.string(),
                 .found = system_error_text(errno),
                 .fix = "check the owner of the folder, and its disk"});
  }
  if (::flock(lock, LOCK_EX | LOCK_NB) == 0) return lock;
  ::close(lock);
  throw UsageError({.what = "another process is using this flight",
                    .where = folder.string(),
                    .fix = "wait for it to end, or end it: what it has stored is kept"});
}

std::int64_t pragma(const SqliteDatabase& database, const char* name) {
  auto statement = database.prepare(fmt::format("PRAGMA {}", name));
  return statement.step() ? statement.integer(0) : 0;
}

bool is_empty(const SqliteDatabase& database) { return !database.prepare("SELECT 1 FROM sqlite_master").step(); }

void check_tables(const SqliteDatabase& database, std::int64_t version) {
  std::set<std::string> missing(kTablesOfVersion3.begin(), kTablesOfVersion3.end());
  if (version > kOldestVersion) missing.insert(kTablesOfVersion4.begin(), kTablesOfVersion4.end());
  auto rows = database.prepare(
      "SELECT sql FROM sqlite_master WHERE sql IS NOT NULL AND name NOT LIKE 'sqlite\\_%' "
      "ESCAPE '\\'");
  std::string found;
  while (rows.step()) {
    if (missing.erase(std::string(rows.text(0))) == 0) found = "also " + printable(rows.text(0).substr(0, 80));
  }
  if (found.empty() && !missing.empty()) found = "no " + missing.begin()->substr(0, 80);
  if (found.empty()) return;
  throw UsageError({.what = "this is not a flight as Nadir stores it",
                    .where = database.path().string(),
                    .expected = fmt::format("the tables of version {}", version),
                    .found = found,
                    .fix = "it was modified: get it from its origin"});
}

std::int64_t checked_version(const SqliteDatabase& database) {
  const std::int64_t version = pragma(database, "user_version");
  const bool ours = pragma(database, "application_id") == kApplication;
  if (ours && version >= kOldestVersion && version <= kFlightStoreVersion) return version;
  throw UsageError({.what = "this is not a flight of this version",
                    .where = database.path().string(),
                    .expected = fmt::format("a flight of version {} or {}", kOldestVersion, kFlightStoreVersion),
                    .found = ours ? fmt::format("version {}", version) : "another database",
                    .fix = ours && version < kOldestVersion
                               ? "export it with the nadir that created it, or process its pictures again in a new "
                                 "flight"
                               : "use the nadir that created it"});
}

bool is_there(const fs::path& folder) {
  std::error_code code;
  return fs::is_regular_file(fs::symlink_status(folder / kFlightFile, code));
}

}  // namespace

FlightDatabase::FlightDatabase(const fs::path& folder, Access access, StoreSync sync, FlightCommitHook hook)
    : hook_(std::move(hook)) {
  if (access == Access::open && !is_there(folder)) {
    throw UsageError({.what = "there is no flight",
                      .where = folder.string(),
                      .expected = fmt::format("a folder with {}", kFlightFile)});
  }
  lock_ = take_lock(folder);
  try {
    database_ = std::make_unique<SqliteDatabase>(SqliteDatabase::open_writable(folder / kFlightFile));
    if (access == Access::open) {
      const std::int64_t version = checked_version(*database_);
      check_tables(*database_, version);
      if (version < kFlightStoreVersion) add_new_tables();
    } else if (!is_empty(*database_)) {
      throw UsageError({.what = "there is a flight already",
                        .where = folder.string(),
                        .expected = "a new folder",
                        .fix = "choose another folder, or open that flight"});
    } else {
      database_->execute("PRAGMA journal_mode = WAL");
    }
    database_->execute("PRAGMA foreign_keys = ON");
    database_->execute(sync == StoreSync::every_commit ? "PRAGMA synchronous = FULL" : "PRAGMA synchronous = NORMAL");
  } catch (...) {
    database_.reset();
    ::close(lock_);
    throw;
  }
}

FlightDatabase::FlightDatabase() : database_(std::make_unique<SqliteDatabase>(SqliteDatabase::in_memory())) {}

FlightDatabase::~FlightDatabase() {
  database_.reset();
  if (lock_ >= 0) ::close(lock_);
}

bool FlightDatabase::exists(const fs::path& folder) {
  return is_there(folder) && !is_empty(SqliteDatabase::open_writable(folder / kFlightFile));
}

void FlightDatabase::create_tables() const {
  database_->execute(fmt::format("PRAGMA application_id = {}", kApplication));
  database_->execute(fmt::format("PRAGMA user_version = {}", kFlightStoreVersion));
  for (const char* table : kTablesOfVersion3) database_->execute(table);
  for (const char* table : kTablesOfVersion4) database_->execute(table);
}

void FlightDatabase::add_new_tables() const {
  database_->transaction([&] {
    for (const char* table : kTablesOfVersion4) database_->execute(table);
    database_->execute(fmt::format("PRAGMA user_version = {}", kFlightStoreVersion));
  });
}

void FlightDatabase::transaction(std::string_view name, const std::function<void()>& work) const {
  database_->transaction([&] {
    work();
    if (hook_) hook_(name, false);
  });
  if (hook_) hook_(name, true);
}

}  // namespace nadir
