// A catalogue's database through GDAL: a SpatiaLite file or a PostGIS server, with the same tables and columns.
//
// External values reach the database only as fields of features; statements are constants of this program, into which
// at most integers are formatted.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "base/time.hpp"
#include "catalogue/geometry.hpp"
#include "catalogue/location.hpp"

class GDALDataset;
class OGRFeature;
class OGRLayer;

namespace nadir {

// A row that was read, or a new one.
class CatalogueRow {
 public:
  explicit CatalogueRow(std::unique_ptr<OGRFeature> feature);
  ~CatalogueRow();
  CatalogueRow(CatalogueRow&&) noexcept;

  CatalogueRow& set(const char* column, std::int64_t value);
  CatalogueRow& set(const char* column, double value);
  CatalogueRow& set(const char* column, std::string_view text);  // unprintable characters become '?'
  CatalogueRow& set(const char* column, UtcTime time);
  CatalogueRow& set_null(const char* column);
  CatalogueRow& shape(GeometryHandle geometry);

  std::int64_t integer(const char* column) const;
  bool is_null(const char* column) const;
  std::string text(const char* column) const;
  std::optional<UtcTime> time(const char* column) const;
  GeoArea area() const;

 private:
  friend class CatalogueDatabase;
  int index(const char* column) const;  // throws Error when there is no such column
  std::unique_ptr<OGRFeature> feature_;
};

// A kind of catalogue: its tables, and how it is identified. Each has a table `catalogue` with its format.
struct CatalogueLayout {
  std::string format;           // "nadir.catalogue/1"
  std::string schema;           // of the tables in PostgreSQL: letters, digits and _
  std::string_view spatialite;  // the statements that create the tables
  std::string_view postgis;
  // Views for people: added when a catalogue that lacks the last one of them is opened for writing.
  std::string_view spatialite_views, postgis_views, last_view;
  std::string maker;  // the command that creates one, for messages: "nadir catalogue add"
  // Tables that only a server needs, whose rows several processes change at a time. Added like the views, but needed.
  std::string_view postgis_shared{}, last_shared{};
};

// Packages of a fleet: docs/formats/catalogue.md.
CatalogueLayout fleet_catalogue();

class CatalogueDatabase {
 public:
  enum class Access { read, write };

  // write: creates an empty catalogue where there is none (the file appears atomically, the schema in one transaction).
  // Throws Error when it cannot be reached, is no catalogue, or is one of another kind or version.
  CatalogueDatabase(const CatalogueLocation& location, Access access, CatalogueLayout layout = fleet_catalogue());
  ~CatalogueDatabase();
  CatalogueDatabase(const CatalogueDatabase&) = delete;
  CatalogueDatabase& operator=(const CatalogueDatabase&) = delete;

  // A transaction that blocks other writers (they wait for a minute, then throw Error). Without commit() nothing
  // changes.
  void begin();
  void commit();
  void roll_back();

  // A server, whose rows several processes may change at a time. Such a transaction blocks nobody: it locks single rows
  // (FOR UPDATE), and before it changes others, join_writers(): those of begin() wait for its end, or it for theirs.
  bool is_server() const { return location_.kind == CatalogueLocation::Kind::postgres; }
  void begin_beside_others();
  void join_writers();
  bool in_transaction() const { return in_transaction_; }

  CatalogueRow new_row(const char* table);
  // Returns the new row's id. Insert::bulk is the fastest way for many rows of one table; it returns no id.
  enum class Insert { one, bulk };
  std::int64_t insert(const char* table, CatalogueRow& row, Insert how);
  void finish_bulk(const char* table);  // throws the errors of the bulk insertion

  // Visits the rows of a table in the order of their ids.
  void each(const char* table, const std::function<void(const CatalogueRow&)>& visit);

  // A statement in SQL that both databases support, with each table's name as `of(TABLE)`. Only constants of this
  // program, integers and hexadecimal digests may be formatted into it.
  void change(const std::string& sql, const char* doing);
  void select(const std::string& sql, const std::function<void(const CatalogueRow&)>& visit);
  std::string of(const char* table) const;
  // The number of rows of this package.
  std::int64_t count(const char* table, std::int64_t package_id);
  void erase(const char* table, const char* column, std::int64_t value);

  bool has_views();
  void copy_view(const char* view, GDALDataset& target);  // as a layer of that name. Throws Error

  // A session that is silent for so long within a transaction is ended by the server, and its locks with it: whoever
  // hangs blocks nobody for longer. A limit that the server, the role or PGOPTIONS sets takes precedence.
  static constexpr std::chrono::milliseconds kSilence = std::chrono::seconds(120);
  // The limit of this session; nullopt: none. A file, or it only reads.
  std::optional<std::chrono::milliseconds> silence() const { return silence_; }

  [[noreturn]] void fail(std::string what) const;  // throws Error with the database's message

 private:
  class ErrorCollector;
  void open(Access access);
  bool has_catalogue();
  void check_format();
  void create_file() const;
  void create_schema();
  void add_views();
  bool has_shared_tables();
  void add_shared_tables();
  void limit_silence();
  void execute(const std::string& sql, const char* doing);
  std::optional<std::string> query_value(const std::string& sql);
  OGRLayer& layer(const char* table);

  CatalogueLocation location_;
  CatalogueLayout layout_;
  std::unique_ptr<ErrorCollector> errors_;
  struct CloseDataset {
    void operator()(GDALDataset* dataset) const;
  };
  std::unique_ptr<GDALDataset, CloseDataset> dataset_;
  bool in_transaction_ = false;
  std::optional<std::chrono::milliseconds> silence_;
};

// Without commit() everything is taken back.
class CatalogueTransaction {
 public:
  explicit CatalogueTransaction(CatalogueDatabase& database) : database_(database) { database_.begin(); }
  ~CatalogueTransaction() {
    if (!committed_) database_.roll_back();
  }
  CatalogueTransaction(const CatalogueTransaction&) = delete;
  CatalogueTransaction& operator=(const CatalogueTransaction&) = delete;

  void commit() {
    database_.commit();
    committed_ = true;
  }

 private:
  CatalogueDatabase& database_;
  bool committed_ = false;
};

// What to do about a message of SQLite or PostgreSQL: a general advice when the message is not a known one.
std::string advice_for_database_message(std::string_view message);

}  // namespace nadir
