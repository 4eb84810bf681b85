// A recorded session as tables, for export.
#pragma once

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
  Table estimates, anchors, events;
};

// Throws as read_recording() does, and UsageError when it is not clear which session is meant.
FlightTables read_flight_tables(const std::filesystem::path& recording, const std::optional<std::string>& session);

}  // namespace nadir
