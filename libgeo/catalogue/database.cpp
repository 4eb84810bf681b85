#include "catalogue/database.hpp"

#include <cpl_conv.h>
#include <fmt/format.h>
#include <gdal_priv.h>
#include <ogrsf_frmts.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <thread>

#include "base/error.hpp"
#include "base/printable.hpp"
#include "catalogue/sql.hpp"
#include "raster/gdal_drivers.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

// Sets a configuration option of GDAL for this thread while it lives.
class ScopedGdalOption {
 public:
  ScopedGdalOption(const char* name, const char* value) : name_(name) { CPLSetThreadLocalConfigOption(name, value); }
  ~ScopedGdalOption() { CPLSetThreadLocalConfigOption(name_, nullptr); }
  ScopedGdalOption(const ScopedGdalOption&) = delete;
  ScopedGdalOption& operator=(const ScopedGdalOption&) = delete;

 private:
  const char* name_;
};

// As SQLite (SQLITE_FULL) and PostgreSQL (disk_full, 53100) say it; GDAL passes on nothing but their texts.
bool says_disk_full(std::string_view message) {
  return message.find("database or disk is full") != std::string_view::npos ||
         message.find("No space left on device") != std::string_view::npos;
}

// Lines that begin with -- are comments; a statement ends with a semicolon at the end of a line.
std::vector<std::string> statements_of(std::string_view sql) {
  std::vector<std::string> statements(1);
  while (!sql.empty()) {
    const std::size_t end = std::min(sql.find('\n'), sql.size() - 1);
    std::string_view line = sql.substr(0, end + 1);
    sql.remove_prefix(end + 1);
    while (line.ends_with('\n')) line.remove_suffix(1);
    if (line.empty() || line.starts_with("--")) continue;
    const bool last = line.ends_with(';');
    if (last) line.remove_suffix(1);
    statements.back().append(line).append("\n");
    if (last) statements.emplace_back();
  }
  statements.pop_back();
  return statements;
}

}  // namespace

// Collects GDAL's errors of this thread. The first message is the cause; later ones are its consequences.
class CatalogueDatabase::ErrorCollector {
 public:
  ErrorCollector() { CPLPushErrorHandlerEx(&ErrorCollector::take, this); }
  ~ErrorCollector() { CPLPopErrorHandler(); }
  ErrorCollector(const ErrorCollector&) = delete;
  ErrorCollector& operator=(const ErrorCollector&) = delete;

  void clear() { first_.clear(); }
  const std::string& first() const { return first_; }

 private:
  static void CPL_STDCALL take(CPLErr severity, CPLErrorNum, const char* message) {
    auto* self = static_cast<ErrorCollector*>(CPLGetErrorHandlerUserData());
    if (severity >= CE_Failure && self->first_.empty()) self->first_ = message;
  }

  std::string first_;
};

void CatalogueDatabase::CloseDataset::operator()(GDALDataset* dataset) const { GDALClose(dataset); }

CatalogueLayout fleet_catalogue() {
  return {.format = "nadir.catalogue/1",
          .schema = "nadir",
          .spatialite = catalogue_sql::spatialite,
          .postgis = catalogue_sql::postgis,
          .spatialite_views = catalogue_sql::spatialite_views,
          .postgis_views = catalogue_sql::postgis_views,
          .last_view = "gap_states",
          .maker = "nadir catalogue add"};
}

CatalogueDatabase::CatalogueDatabase(const CatalogueLocation& location, Access access, CatalogueLayout layout)
    : location_(location), layout_(std::move(layout)), errors_(std::make_unique<ErrorCollector>()) {
  register_gdal_drivers();
  open(access);
  if (location_.kind == CatalogueLocation::Kind::postgres) {
    if (query_value("SELECT extname FROM pg_extension WHERE extname = 'postgis'") != "postgis") {
      throw Error({.what = "the database has no PostGIS",
                   .where = location_.shown,
                   .expected = "the extension postgis",
                   .found = errors_->first(),
                   .fix = "run as an administrator of the database: CREATE EXTENSION postgis"});
    }
    if (access == Access::write) {
      execute("SET lock_timeout = '60s'", "setting up the connection");
      limit_silence();
      if (!has_catalogue()) create_schema();
    }
  }
  check_format();
  if (access == Access::read) return;
  add_views();
  if (is_server()) add_shared_tables();
}

CatalogueDatabase::~CatalogueDatabase() {
  if (in_transaction_) roll_back();
  dataset_.reset();
}

void CatalogueDatabase::open(Access access) {
  const bool file = location_.kind == CatalogueLocation::Kind::file;
  if (file) {
    std::error_code code;
    const fs::file_status status = fs::status(location_.name, code);
    if (!fs::exists(status)) {
      if (access == Access::read) {
        throw UsageError({.what = "no such catalogue",
                          .where = location_.shown,
                          .expected = fmt::format("a file created by `{}`, or \"PG:dbname=… host=…\"", layout_.maker)});
      }
      create_file();
    } else if (!fs::is_regular_file(status)) {
      throw UsageError(
          {.what = "the catalogue is not a file", .where = location_.shown, .expected = "a SpatiaLite file"});
    }
  }
  const ScopedGdalOption busy_timeout("SQLITE_BUSY_TIMEOUT", "60000");
  const char* const drivers[] = {file ? "SQLite" : "PostgreSQL", nullptr};
  // The journal of a killed writer is rolled back by the next process with write access, even if it only reads.
  const bool has_journal =
      file && fs::exists(location_.name + "-journal") && ::access(location_.name.c_str(), W_OK) == 0;
  const unsigned flags = GDAL_OF_VECTOR | GDAL_OF_VERBOSE_ERROR |
                         (access == Access::write || has_journal ? GDAL_OF_UPDATE : GDAL_OF_READONLY);
  errors_->clear();
  dataset_.reset(GDALDataset::Open(location_.name.c_str(), flags, drivers));
  if (!dataset_) fail(file ? "the catalogue cannot be opened" : "the database cannot be reached");
}

void CatalogueDatabase::fail(std::string what) const {
  const std::string& message = errors_->first();
  const bool full = says_disk_full(message);
  ErrorText text{.what = std::move(what),
                 .where = location_.shown,
                 .found = message.empty() ? "no message from the database" : printable(message),
                 .fix = full ? "make room on the catalogue's disk" : advice_for_database_message(message)};
  if (full) throw OutOfSpace(std::move(text));
  throw Error(std::move(text));
}

bool CatalogueDatabase::has_catalogue() {
  if (location_.kind == CatalogueLocation::Kind::postgres) {
    return query_value(
               fmt::format("SELECT 1 FROM information_schema.schemata WHERE schema_name = '{}'", layout_.schema)) &&
           query_value(fmt::format("SELECT 1 FROM pg_tables WHERE schemaname = '{}' AND tablename = 'catalogue'",
                                   layout_.schema));
  }
  return query_value("SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = 'catalogue'").has_value();
}

void CatalogueDatabase::check_format() {
  const bool there = has_catalogue();
  if (!there && !errors_->first().empty()) fail("the catalogue cannot be read");
  const auto format = there ? query_value("SELECT format FROM " + of("catalogue")) : std::nullopt;
  if (there && !format && !errors_->first().empty()) fail("the catalogue cannot be read");
  if (format == layout_.format) return;
  throw UsageError(
      {.what = "this is not a catalogue of this version",
       .where = location_.shown,
       .expected = layout_.format,
       .found = printable(format.value_or(there ? "a table without a format" : "no catalogue")),
       .fix = fmt::format("`{}` creates one; it does not change a database that holds other tables", layout_.maker)});
}

// Filled under a hidden name and hard linked to its final name: of two concurrent processes the first one wins.
void CatalogueDatabase::create_file() const {
  const fs::path final_path = location_.name;
  const fs::path staging =
      final_path.parent_path() / fmt::format(".{}.{}.new", final_path.filename().string(), ::getpid());
  std::error_code code;
  fs::remove(staging, code);
  errors_->clear();
  try {
    GDALDriver* driver = GetGDALDriverManager()->GetDriverByName("SQLite");
    const char* const options[] = {"SPATIALITE=YES", "INIT_WITH_EPSG=NO", nullptr};
    std::unique_ptr<GDALDataset, CloseDataset> created(
        driver == nullptr ? nullptr
                          : driver->Create(staging.c_str(), 0, 0, 0, GDT_Unknown, const_cast<char**>(options)));
    if (!created || created->StartTransaction() != OGRERR_NONE) fail("the catalogue cannot be created");
    for (const std::string& statement : statements_of(layout_.spatialite)) {
      if (OGRLayer* result = created->ExecuteSQL(statement.c_str(), nullptr, nullptr); result != nullptr) {
        const std::unique_ptr<OGRFeature> row(result->GetNextFeature());
        const bool done = row && row->GetFieldCount() > 0 && row->GetFieldAsInteger(0) == 1;
        created->ReleaseResultSet(result);
        // SpatiaLite's functions return 1 on success.
        if (!done) fail("the catalogue's tables cannot be created: " + statement);
      }
      if (!errors_->first().empty()) fail("the catalogue's tables cannot be created");
    }
    if (created->CommitTransaction() != OGRERR_NONE) fail("the catalogue cannot be created");
    created.reset();
    fs::create_hard_link(staging, final_path, code);
    if (code && !fs::exists(final_path)) {
      throw Error({.what = "the catalogue file cannot be renamed", .where = location_.shown, .found = code.message()});
    }
  } catch (...) {
    fs::remove(staging, code);
    throw;
  }
  fs::remove(staging, code);
}

void CatalogueDatabase::create_schema() {
  // One process creates the schema; the key of the advisory lock is arbitrary ("nadir").
  constexpr std::int64_t kLock = 0x6e61646972;
  if (dataset_->StartTransaction() != OGRERR_NONE) fail("the catalogue cannot be created");
  in_transaction_ = true;
  query_value(fmt::format("SELECT pg_advisory_xact_lock({})", kLock));
  if (!errors_->first().empty()) fail("the catalogue cannot be created");
  if (!has_catalogue()) {
    for (const std::string& statement : statements_of(layout_.postgis)) {
      execute(statement, "creating the catalogue's tables");
    }
  }
  commit();
}

bool CatalogueDatabase::has_views() {
  const bool postgres = location_.kind == CatalogueLocation::Kind::postgres;
  return query_value(postgres ? fmt::format("SELECT 1 FROM pg_views WHERE schemaname = '{}' AND viewname = '{}'",
                                            layout_.schema, layout_.last_view)
                              : fmt::format("SELECT 1 FROM sqlite_master WHERE type = 'view' AND name = '{}'",
                                            layout_.last_view))
      .has_value();
}

void CatalogueDatabase::copy_view(const char* view, GDALDataset& target) {
  if (is_server()) execute("SET timezone = 'UTC'", "asking for times in UTC");
  CPLErrorReset();
  const OGRLayer* copy = target.CopyLayer(&layer(view), view);
  if (copy != nullptr && CPLGetLastErrorType() < CE_Failure) return;
  throw Error({.what = fmt::format("the catalogue's {} cannot be exported", view),
               .where = location_.shown,
               .found = CPLGetLastErrorMsg(),
               .fix = "see whether its disk is full"});
}

// A user of a server who may write rows but not create views does without them.
void CatalogueDatabase::add_views() {
  if (has_views()) return;
  const bool postgres = location_.kind == CatalogueLocation::Kind::postgres;
  try {
    begin();
    // Of two processes the second one finds them.
    if (!has_views()) {
      for (const std::string& statement : statements_of(postgres ? layout_.postgis_views : layout_.spatialite_views)) {
        execute(statement, "creating the catalogue's views");
      }
    }
    commit();
  } catch (const Error&) {
    if (in_transaction_) roll_back();
    errors_->clear();
  }
}

bool CatalogueDatabase::has_shared_tables() {
  return layout_.last_shared.empty() ||
         query_value(fmt::format("SELECT 1 FROM pg_tables WHERE schemaname = '{}' AND tablename = '{}'", layout_.schema,
                                 layout_.last_shared))
             .has_value();
}

void CatalogueDatabase::add_shared_tables() {
  if (has_shared_tables()) return;
  try {
    begin();
    if (!has_shared_tables()) {
      for (const std::string& statement : statements_of(layout_.postgis_shared)) {
        execute(statement, "creating the catalogue's tables");
      }
    }
    commit();
  } catch (const Error& error) {
    throw Error({.what = "the catalogue lacks a table of this version, and it cannot be created",
                 .where = location_.shown,
                 .expected = fmt::format("the table {}.{}", layout_.schema, layout_.last_shared),
                 .found = error.text().found,
                 .fix = fmt::format("run `{}` once as the owner of the schema {}", layout_.maker, layout_.schema)});
  }
}

void CatalogueDatabase::limit_silence() {
  constexpr const char* kSetting = "idle_in_transaction_session_timeout";
  const auto set = query_value(fmt::format("SELECT setting::bigint FROM pg_settings WHERE name = '{}'", kSetting));
  silence_ = std::chrono::milliseconds(std::atoll(set.value_or("0").c_str()));
  if (silence_->count() > 0) return;
  silence_ = kSilence;
  execute(fmt::format("SET {} = {}", kSetting, kSilence.count()), "setting up the connection");
}

void CatalogueDatabase::execute(const std::string& sql, const char* doing) {
  errors_->clear();
  if (OGRLayer* result = dataset_->ExecuteSQL(sql.c_str(), nullptr, nullptr); result != nullptr) {
    dataset_->ReleaseResultSet(result);
  }
  if (!errors_->first().empty()) fail(fmt::format("the database reported an error while {}", doing));
}

std::optional<std::string> CatalogueDatabase::query_value(const std::string& sql) {
  errors_->clear();
  OGRLayer* result = dataset_->ExecuteSQL(sql.c_str(), nullptr, nullptr);
  if (result == nullptr) return std::nullopt;
  std::optional<std::string> answer;
  if (const std::unique_ptr<OGRFeature> row(result->GetNextFeature()); row && row->GetFieldCount() > 0) {
    answer = row->GetFieldAsString(0);
  }
  dataset_->ReleaseResultSet(result);
  return answer;
}

std::string CatalogueDatabase::of(const char* table) const {
  return (location_.kind == CatalogueLocation::Kind::postgres ? layout_.schema + "." : "") + std::string(table);
}

OGRLayer& CatalogueDatabase::layer(const char* table) {
  OGRLayer* found = dataset_->GetLayerByName(of(table).c_str());
  if (found == nullptr) fail(fmt::format("the catalogue's table {} cannot be opened", table));
  return *found;
}

void CatalogueDatabase::begin() {
  const bool postgres = location_.kind == CatalogueLocation::Kind::postgres;
  // PostgreSQL waits by itself. SQLite returns at once where two writers would deadlock: retry for a minute.
  constexpr int kAttempts = 600;
  constexpr auto kRetryInterval = std::chrono::milliseconds(100);
  for (int attempt = 1;; ++attempt) {
    errors_->clear();
    if (dataset_->StartTransaction() != OGRERR_NONE) fail("a transaction cannot be started");
    in_transaction_ = true;
    try {
      // The first statement takes the lock, before anything is read: what is read afterwards cannot change.
      execute(
          postgres ? "LOCK TABLE " + of("catalogue") + " IN EXCLUSIVE MODE" : "UPDATE catalogue SET format = format",
          "locking the catalogue for writing");
      return;
    } catch (const Error&) {
      const bool locked = !postgres && errors_->first().find("locked") != std::string::npos;
      roll_back();
      if (!locked || attempt == kAttempts) throw;
    }
    std::this_thread::sleep_for(kRetryInterval);
  }
}

void CatalogueDatabase::begin_beside_others() {
  errors_->clear();
  if (dataset_->StartTransaction() != OGRERR_NONE) fail("a transaction cannot be started");
  in_transaction_ = true;
}

void CatalogueDatabase::join_writers() {
  execute("LOCK TABLE " + of("catalogue") + " IN ROW SHARE MODE", "waiting for another writer");
}

void CatalogueDatabase::commit() {
  errors_->clear();
  const OGRErr code = dataset_->CommitTransaction();
  if (code != OGRERR_NONE || !errors_->first().empty()) fail("the transaction cannot be committed");
  in_transaction_ = false;
}

void CatalogueDatabase::roll_back() {
  dataset_->RollbackTransaction();
  in_transaction_ = false;
}

CatalogueRow CatalogueDatabase::new_row(const char* table) {
  return CatalogueRow(std::make_unique<OGRFeature>(layer(table).GetLayerDefn()));
}

std::int64_t CatalogueDatabase::insert(const char* table, CatalogueRow& row, Insert how) {
  // GDAL reads this option at the first row of a table.
  const ScopedGdalOption copy("PG_USE_COPY", how == Insert::bulk ? "YES" : "NO");
  if (layer(table).CreateFeature(row.feature_.get()) != OGRERR_NONE || !errors_->first().empty()) {
    fail(fmt::format("a row of {} cannot be written", table));
  }
  return row.feature_->GetFID();
}

void CatalogueDatabase::finish_bulk(const char* table) {
  if (layer(table).SyncToDisk() != OGRERR_NONE || !errors_->first().empty()) {
    fail(fmt::format("the rows of {} cannot be written", table));
  }
}

void CatalogueDatabase::each(const char* table, const std::function<void(const CatalogueRow&)>& visit) {
  select(fmt::format("SELECT * FROM {} ORDER BY id", of(table)), visit);
}

void CatalogueDatabase::select(const std::string& sql, const std::function<void(const CatalogueRow&)>& visit) {
  errors_->clear();
  OGRLayer* rows = dataset_->ExecuteSQL(sql.c_str(), nullptr, nullptr);
  if (rows == nullptr && !errors_->first().empty()) fail("the catalogue's rows cannot be read");
  if (rows == nullptr) return;  // GDAL's result without rows
  const auto release = [this](OGRLayer* result) { dataset_->ReleaseResultSet(result); };
  const std::unique_ptr<OGRLayer, decltype(release)> guard(rows, release);
  while (auto* feature = rows->GetNextFeature()) visit(CatalogueRow(std::unique_ptr<OGRFeature>(feature)));
  if (!errors_->first().empty()) fail("the catalogue's rows cannot be read");
}

void CatalogueDatabase::change(const std::string& sql, const char* doing) { execute(sql, doing); }

std::int64_t CatalogueDatabase::count(const char* table, std::int64_t package_id) {
  const auto answer = query_value(fmt::format("SELECT count(*) FROM {} WHERE package_id = {}", of(table), package_id));
  if (!answer) fail(fmt::format("the rows of {} cannot be counted", table));
  return std::stoll(*answer);
}

void CatalogueDatabase::erase(const char* table, const char* column, std::int64_t value) {
  execute(fmt::format("DELETE FROM {} WHERE {} = {}", of(table), column, value), "removing rows");
}

CatalogueRow::CatalogueRow(std::unique_ptr<OGRFeature> feature) : feature_(std::move(feature)) {}
CatalogueRow::~CatalogueRow() = default;
CatalogueRow::CatalogueRow(CatalogueRow&&) noexcept = default;

int CatalogueRow::index(const char* column) const {
  const int found = feature_->GetFieldIndex(column);
  if (found < 0) {
    throw Error({.what = "a column of the catalogue is missing",
                 .where = std::string(feature_->GetDefnRef()->GetName()),
                 .expected = column,
                 .fix = "the tables were changed; create a new catalogue"});
  }
  return found;
}

CatalogueRow& CatalogueRow::set(const char* column, std::int64_t value) {
  feature_->SetField(index(column), static_cast<GIntBig>(value));
  return *this;
}

CatalogueRow& CatalogueRow::set(const char* column, double value) {
  feature_->SetField(index(column), value);
  return *this;
}

CatalogueRow& CatalogueRow::set(const char* column, std::string_view text) {
  feature_->SetField(index(column), printable(text).c_str());
  return *this;
}

CatalogueRow& CatalogueRow::set(const char* column, UtcTime time) {
  // "2024-10-30T00:00:00Z": fields at fixed positions
  const std::string text = to_rfc3339(time);
  const auto part = [&text](std::size_t at, std::size_t length) {
    int value = 0;
    std::from_chars(text.data() + at, text.data() + at + length, value);
    return value;
  };
  constexpr int kUtc = 100;  // OGR's time zone flag
  feature_->SetField(index(column), part(0, 4), part(5, 2), part(8, 2), part(11, 2), part(14, 2),
                     static_cast<float>(part(17, 2)), kUtc);
  return *this;
}

CatalogueRow& CatalogueRow::set_null(const char* column) {
  feature_->SetFieldNull(index(column));
  return *this;
}

CatalogueRow& CatalogueRow::shape(GeometryHandle geometry) {
  if (const OGRSpatialReference* reference = feature_->GetDefnRef()->GetGeomFieldCount() > 0
                                                 ? feature_->GetDefnRef()->GetGeomFieldDefn(0)->GetSpatialRef()
                                                 : nullptr;
      reference != nullptr) {
    geometry->assignSpatialReference(const_cast<OGRSpatialReference*>(reference));
  }
  feature_->SetGeometryDirectly(geometry.release());
  return *this;
}

std::int64_t CatalogueRow::integer(const char* column) const { return feature_->GetFieldAsInteger64(index(column)); }

bool CatalogueRow::is_null(const char* column) const { return !feature_->IsFieldSetAndNotNull(index(column)); }

std::string CatalogueRow::text(const char* column) const { return feature_->GetFieldAsString(index(column)); }

std::optional<UtcTime> CatalogueRow::time(const char* column) const {
  int year = 0, month = 0, day = 0, hour = 0, minute = 0, zone = 0;
  float second = 0;
  const int field = index(column);
  if (!feature_->IsFieldSetAndNotNull(field) ||
      feature_->GetFieldAsDateTime(field, &year, &month, &day, &hour, &minute, &second, &zone) == FALSE) {
    return std::nullopt;
  }
  const auto local =
      parse_utc(CPLSPrintf("%04d-%02d-%02dT%02d:%02d:%02dZ", year, month, day, hour, minute, static_cast<int>(second)));
  // Servers return times in their session's time zone: OGR counts quarters of an hour from 100, which is UTC.
  constexpr int kUtc = 100, kQuarter_s = 900;
  if (local && zone > 1) return UtcTime{local->unix_s - std::int64_t{zone - kUtc} * kQuarter_s};
  return local;
}

GeoArea CatalogueRow::area() const {
  const OGRGeometry* geometry = feature_->GetGeometryRef();
  return geometry == nullptr ? GeoArea() : area_from(*geometry);
}

namespace {

struct ErrorAdvice {
  std::string_view pattern;  // part of the message
  std::string_view fix;
};

constexpr std::array kErrorAdvice{
    ErrorAdvice{"password", "set the password in PGPASSWORD, in ~/.pgpass, or as password=… in the connection string"},
    ErrorAdvice{"no pg_hba.conf entry", "the server does not accept this user from this host: ask its administrator"},
    ErrorAdvice{"server closed the connection",
                "the connection was lost and nothing was written; run the command again when the server is available"},
    ErrorAdvice{"idle-in-transaction timeout",
                "this process was silent for too long within a transaction, and nothing was written: check its load"},
    ErrorAdvice{"terminating connection",
                "the connection was lost and nothing was written; run the command again when the server is available"},
    ErrorAdvice{"no connection to the server",
                "the connection was lost and nothing was written; run the command again when the server is available"},
    ErrorAdvice{"Is the server running", "start the server, or correct host and port in the connection string"},
    ErrorAdvice{"could not translate host name", "correct the host in the connection string"},
    ErrorAdvice{"Connection refused", "start the server, or correct host and port in the connection string"},
    ErrorAdvice{"the database system is", "the server is starting or stopping; run the command again in a moment"},
    ErrorAdvice{
        "permission denied",
        "request the privileges: USAGE on the schema nadir, and on its tables SELECT to read, also INSERT, UPDATE and "
        "DELETE to write"},
    ErrorAdvice{"Permission denied",
                "request write permission for the file and its folder, or copy the file to a writable folder"},
    ErrorAdvice{"read-only transaction", "the database is read-only: use the primary server, not a replica"},
    ErrorAdvice{"readonly database", "the file is read-only: copy it to a writable folder"},
    ErrorAdvice{"lock timeout",
                "another process is writing to this catalogue; run the command again when it has finished"},
    ErrorAdvice{"database is locked",
                "another process is writing to this catalogue; run the command again when it has finished"},
    ErrorAdvice{"deadlock", "another process is writing to this catalogue; run the command again when it has finished"},
    ErrorAdvice{"disk is full", "free space on the disk, and run the command again; nothing was written"},
    ErrorAdvice{"No space left", "free space on the disk, and run the command again; nothing was written"},
    ErrorAdvice{"role \"",
                "correct the user in the connection string, or have an administrator create it: createuser NAME"},
    ErrorAdvice{"does not exist",
                "create the database: createdb NAME, then psql -d NAME -c 'CREATE EXTENSION postgis'"},
    ErrorAdvice{"malformed",
                "the file is damaged: restore a backup, or create a new catalogue and add the packages again"},
    ErrorAdvice{"not a database", "use a catalogue created by `nadir catalogue add`"},
};

}  // namespace

std::string advice_for_database_message(std::string_view message) {
  for (const ErrorAdvice& advice : kErrorAdvice) {
    if (message.find(advice.pattern) != std::string_view::npos) return std::string(advice.fix);
  }
  return "check the same location with `ogrinfo -so`";
}

}  // namespace nadir
