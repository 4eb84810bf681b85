#include "vision/place_table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/json.hpp"
#include "base/bytes.hpp"

namespace nadir {
namespace {

using nlohmann::json;

static_assert(std::endian::native == std::endian::little, "numbers are stored as little-endian float32");

std::string packed(std::span<const float> numbers) {
  return to_base64({reinterpret_cast<const std::uint8_t*>(numbers.data()), numbers.size_bytes()});
}

// Turns a parsed document into a table or throws. Every number is checked before it is used for anything.
class Reader {
 public:
  Reader(const json& root, std::string_view name) : root_(root), name_(name) {}

  PlaceTable read() const {
    only(root_, "",
         {"schema", "descriptor", "imagery_merkle_root", "origin_e7", "overlap_percent", "zoom", "layers", "chunks",
          "mean", "basis", "kept_ppm"});
    if (text(root_, "schema") != kPlaceTableSchema) refuse("/schema", std::string(kPlaceTableSchema));
    if (text(root_, "descriptor") != kPlaceDescriptorName) refuse("/descriptor", std::string(kPlaceDescriptorName));
    PlaceTable table;
    const auto root = Sha256::from_hex(text(root_, "imagery_merkle_root"));
    if (!root) refuse("/imagery_merkle_root", "64 lower-case hexadecimal digits");
    table.imagery_root = *root;
    const json& origin = list(root_, "origin_e7", 2, 2);
    table.origin_lon_e7 = whole(origin[0], "/origin_e7/0", -kLon_e7, kLon_e7);
    table.origin_lat_e7 = whole(origin[1], "/origin_e7/1", -kLat_e7, kLat_e7);
    table.overlap_percent = whole(member(root_, "overlap_percent"), "/overlap_percent", 0, 90);
    table.zoom = whole(member(root_, "zoom"), "/zoom", 0, kMaxZoom);
    table.projection.mean = numbers("mean", kRawPlaceSize);
    table.projection.basis = numbers("basis", kRawPlaceSize * kPlaceSize);
    table.projection.kept = static_cast<double>(whole(member(root_, "kept_ppm"), "/kept_ppm", 0, 1'000'000)) / 1e6;
    read_chunks(table);
    read_layers(table);
    return table;
  }

 private:
  static constexpr std::int64_t kLon_e7 = 1'800'000'000;
  static constexpr std::int64_t kLat_e7 = 900'000'000;

  [[noreturn]] void refuse(const std::string& where, std::string expected) const {
    throw Error({.what = "this is no table of places",
                 .where = std::string(name_) + where,
                 .expected = std::move(expected),
                 .found = "something else",
                 .fix = "make it again with `nadir cache index`"});
  }
  void only(const json& object, const std::string& where, std::initializer_list<std::string_view> known) const {
    if (!object.is_object()) refuse(where, "an object");
    for (const auto& [name, ignored] : object.items()) {
      if (std::find(known.begin(), known.end(), name) == known.end()) refuse(where, "only members that are known");
    }
  }
  const json& member(const json& object, const char* name) const {
    const auto found = object.find(name);
    if (found == object.end()) refuse("", fmt::format("a member \"{}\"", name));
    return *found;
  }
  std::string text(const json& object, const char* name) const {
    const auto* string = member(object, name).get_ptr<const std::string*>();
    if (string == nullptr) refuse(fmt::format("/{}", name), "text");
    return *string;
  }
  const json& list(const json& object, const char* name, std::size_t least, std::size_t most) const {
    const json& value = member(object, name);
    if (!value.is_array() || value.size() < least || value.size() > most) {
      refuse(fmt::format("/{}", name), fmt::format("a list of {} to {}", least, most));
    }
    return value;
  }
  std::int64_t whole(const json& value, const std::string& where, std::int64_t low, std::int64_t high) const {
    const bool fits = value.is_number_unsigned()
                          ? value.get<std::uint64_t>() <= static_cast<std::uint64_t>(std::max<std::int64_t>(high, 0))
                          : value.is_number_integer();
    if (!fits || value.get<std::int64_t>() < low || value.get<std::int64_t>() > high) {
      refuse(where, fmt::format("a whole number from {} to {}", low, high));
    }
    return value.get<std::int64_t>();
  }
  std::vector<float> numbers(const char* name, std::size_t count) const {
    const auto bytes = from_base64(text(root_, name));
    if (!bytes || bytes->size() != count * sizeof(float)) {
      refuse(fmt::format("/{}", name), fmt::format("{} float32 in base64", count));
    }
    std::vector<float> result(count);
    std::copy(bytes->begin(), bytes->end(), reinterpret_cast<std::uint8_t*>(result.data()));
    const bool sound = std::all_of(result.begin(), result.end(), [](float v) { return std::abs(v) <= 1.001F; });
    if (!sound) refuse(fmt::format("/{}", name), "numbers between -1 and 1");
    return result;
  }
  void read_chunks(PlaceTable& table) const {
    const json& chunks = list(root_, "chunks", 0, kMaxPlaceChunks);
    const std::int64_t last_tile = (std::int64_t{1} << table.zoom) - 1;
    table.chunks.reserve(chunks.size());
    for (std::size_t i = 0; i < chunks.size(); ++i) {
      const json& row = chunks[i];
      const std::string where = fmt::format("/chunks/{}", i);
      if (!row.is_array() || row.size() != 4) refuse(where, "lon_e7, lat_e7, tile x, tile y");
      PlaceChunk chunk;
      chunk.lon_e7 = whole(row[0], where + "/0", -kLon_e7, kLon_e7);
      chunk.lat_e7 = whole(row[1], where + "/1", -kLat_e7, kLat_e7);
      chunk.tile = {static_cast<std::uint8_t>(table.zoom),
                    static_cast<std::uint32_t>(whole(row[2], where + "/2", 0, last_tile)),
                    static_cast<std::uint32_t>(whole(row[3], where + "/3", 0, last_tile))};
      table.chunks.push_back(chunk);
    }
  }
  void read_layers(PlaceTable& table) const {
    const json& layers = list(root_, "layers", 1, kMaxPlaceLayers);
    std::size_t next = 0;
    for (std::size_t i = 0; i < layers.size(); ++i) {
      const json& object = layers[i];
      const std::string where = fmt::format("/layers/{}", i);
      only(object, where, {"side_mm", "side_px", "count", "textureless", "invalid"});
      const auto number = [&](const char* name, std::int64_t low, std::int64_t high) {
        return whole(member(object, name), where + "/" + name, low, high);
      };
      PlaceLayer layer;
      layer.side_mm = number("side_mm", 1000, 100'000'000);
      layer.side_px = number("side_px", 32, 256);
      layer.first = next;
      const std::size_t left = table.chunks.size() - next;
      layer.count = static_cast<std::size_t>(number("count", 0, static_cast<std::int64_t>(left)));
      layer.textureless = static_cast<std::size_t>(number("textureless", 0, std::int64_t{1} << 40));
      layer.invalid = static_cast<std::size_t>(number("invalid", 0, std::int64_t{1} << 40));
      next += layer.count;
      table.layers.push_back(layer);
    }
    if (next != table.chunks.size()) refuse("/layers", fmt::format("{} chunks in all", table.chunks.size()));
  }

  const json& root_;
  std::string_view name_;
};

}  // namespace

std::string place_table_json(const PlaceTable& table) {
  json layers = json::array();
  for (const PlaceLayer& layer : table.layers) {
    layers.push_back({{"side_mm", layer.side_mm},
                      {"side_px", layer.side_px},
                      {"count", layer.count},
                      {"textureless", layer.textureless},
                      {"invalid", layer.invalid}});
  }
  json chunks = json::array();
  for (const PlaceChunk& chunk : table.chunks) {
    chunks.push_back({chunk.lon_e7, chunk.lat_e7, chunk.tile.x, chunk.tile.y});
  }
  const json document{{"schema", kPlaceTableSchema},
                      {"descriptor", kPlaceDescriptorName},
                      {"imagery_merkle_root", table.imagery_root.hex()},
                      {"origin_e7", {table.origin_lon_e7, table.origin_lat_e7}},
                      {"overlap_percent", table.overlap_percent},
                      {"zoom", table.zoom},
                      {"layers", layers},
                      {"chunks", chunks},
                      {"mean", packed(table.projection.mean)},
                      {"basis", packed(table.projection.basis)},
                      {"kept_ppm", std::llround(std::clamp(table.projection.kept, 0.0, 1.0) * 1e6)}};
  return document.dump() + "\n";
}

PlaceTable parse_place_table(std::string_view text, std::string_view name) {
  if (text.size() > kMaxPlaceTableSize) {
    throw Error({.what = "this table of places is too large",
                 .where = std::string(name),
                 .expected = fmt::format("at most {} bytes", kMaxPlaceTableSize),
                 .found = fmt::format("{} bytes", text.size())});
  }
  const json document = parse_json(text, name, {.max_depth = 4, .allow_floats = false});
  return Reader(document, name).read();
}

}  // namespace nadir
