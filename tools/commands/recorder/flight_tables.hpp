// A recorded flight as tables: estimates, anchors, fixes, events. `nadir recorder export` writes them in several
// formats, `nadir replay` the fixes that it made again.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "geodesy/lon_lat.hpp"
#include "recorder/records.hpp"

namespace nadir {

using Cell = std::variant<std::monostate, std::int64_t, double, std::string>;  // monostate: unknown
enum class CellType { integer, real, text };

struct Column {
  std::string name;
  CellType type = CellType::real;
};

struct TableRow {
  std::optional<LonLat> place;
  std::vector<Cell> cells;
};

struct Table {
  std::string name;
  bool places = false;  // rows have places
  std::vector<Column> columns;
  std::vector<TableRow> rows;
};

struct FlightTables {
  std::string session;
  Table estimates, anchors, fixes, events;
};

// A recorded session as tables. Throws as read_recording() does, and UsageError when it is not clear which session is
// meant.
FlightTables read_flight_tables(const std::filesystem::path& recording, const std::optional<std::string>& session);

Table fixes_table(const std::vector<FixRecord>& fixes);

// RFC 4180; positions as lat_deg and lon_deg.
std::string csv_of(const Table& table);

}  // namespace nadir
