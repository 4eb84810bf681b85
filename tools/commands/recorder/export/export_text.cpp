#include "commands/recorder/export/export_text.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "base/files.hpp"

namespace nadir {
namespace {

using nlohmann::json;

std::string quoted(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string result = "\"";
  for (const char c : text) result += c == '"' ? std::string("\"\"") : std::string(1, c);
  return result + '"';
}

std::string csv_cell(const Cell& cell) {
  if (const auto* text = std::get_if<std::string>(&cell)) return quoted(*text);
  if (const auto* number = std::get_if<double>(&cell)) return std::isfinite(*number) ? fmt::format("{}", *number) : "";
  if (const auto* number = std::get_if<std::int64_t>(&cell)) return fmt::format("{}", *number);
  return "";
}

std::string csv_of(const Table& table) {
  std::string text;
  for (const Column& column : table.columns) text += (text.empty() ? "" : ",") + column.name;
  text += table.places ? ",lat_deg,lon_deg\n" : "\n";
  for (const TableRow& row : table.rows) {
    std::string line;
    for (std::size_t i = 0; i < row.cells.size(); ++i) line += (i == 0 ? "" : ",") + csv_cell(row.cells[i]);
    if (table.places) line += row.place ? fmt::format(",{:.9f},{:.9f}", row.place->lat_deg, row.place->lon_deg) : ",,";
    text += line + "\n";
  }
  return text;
}

json json_of(const Cell& cell) {
  if (const auto* text = std::get_if<std::string>(&cell)) return *text;
  if (const auto* number = std::get_if<double>(&cell)) return std::isfinite(*number) ? json(*number) : json();
  if (const auto* number = std::get_if<std::int64_t>(&cell)) return *number;
  return {};
}

json position(LonLat place) {
  return json::array({std::round(place.lon_deg * 1e9) / 1e9, std::round(place.lat_deg * 1e9) / 1e9});
}

void add_points(json& features, const Table& table, const char* kind) {
  for (const TableRow& row : table.rows) {
    if (!row.place) continue;
    json properties{{"kind", kind}};
    for (std::size_t i = 0; i < row.cells.size(); ++i) properties[table.columns[i].name] = json_of(row.cells[i]);
    features.push_back({{"type", "Feature"},
                        {"geometry", {{"type", "Point"}, {"coordinates", position(*row.place)}}},
                        {"properties", std::move(properties)}});
  }
}

}  // namespace

void export_csv(const FlightTables& tables, const std::filesystem::path& folder) {
  for (const Table* table : {&tables.estimates, &tables.anchors, &tables.events}) {
    write_file_atomic(folder / (table->name + ".csv"), csv_of(*table));
  }
}

std::string geojson_of(const FlightTables& tables) {
  json features = json::array(), line = json::array();
  for (const TableRow& row : tables.estimates.rows) {
    if (row.place) line.push_back(position(*row.place));
  }
  if (line.size() >= 2) {
    features.push_back({{"type", "Feature"},
                        {"geometry", {{"type", "LineString"}, {"coordinates", std::move(line)}}},
                        {"properties", {{"kind", "track"}, {"session", tables.session}}}});
  }
  add_points(features, tables.estimates, "estimate");
  add_points(features, tables.anchors, "anchor");
  const json document{{"type", "FeatureCollection"}, {"features", std::move(features)}};
  return document.dump(1, ' ', false, json::error_handler_t::replace) + "\n";
}

}  // namespace nadir
