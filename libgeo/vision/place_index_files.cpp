#include "vision/place_index_files.hpp"

#include <faiss/IndexFlat.h>
#include <faiss/impl/FaissException.h>
#include <faiss/impl/IDSelector.h>
#include <faiss/impl/io.h>
#include <faiss/index_io.h>
#include <fmt/format.h>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
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
    if (text(root_, "schema") != kPlaceTableSchema) reject("/schema", std::string(kPlaceTableSchema));
    if (text(root_, "descriptor") != kPlaceDescriptorName) reject("/descriptor", std::string(kPlaceDescriptorName));
    PlaceTable table;
    const auto root = Sha256::from_hex(text(root_, "imagery_merkle_root"));
    if (!root) reject("/imagery_merkle_root", "64 lower-case hexadecimal digits");
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

  [[noreturn]] void reject(const std::string& where, std::string expected) const {
    throw Error({.what = "not a table of places",
                 .where = std::string(name_) + where,
                 .expected = std::move(expected),
                 .found = "something else",
                 .fix = "rebuild it with `nadir cache index`"});
  }
  void only(const json& object, const std::string& where, std::initializer_list<std::string_view> known) const {
    if (!object.is_object()) reject(where, "an object");
    for (const auto& [name, ignored] : object.items()) {
      if (std::find(known.begin(), known.end(), name) == known.end()) reject(where, "known members only");
    }
  }
  const json& member(const json& object, const char* name) const {
    const auto found = object.find(name);
    if (found == object.end()) reject("", fmt::format("a member \"{}\"", name));
    return *found;
  }
  std::string text(const json& object, const char* name) const {
    const auto* string = member(object, name).get_ptr<const std::string*>();
    if (string == nullptr) reject(fmt::format("/{}", name), "text");
    return *string;
  }
  const json& list(const json& object, const char* name, std::size_t least, std::size_t most) const {
    const json& value = member(object, name);
    if (!value.is_array() || value.size() < least || value.size() > most) {
      reject(fmt::format("/{}", name), fmt::format("a list of {} to {}", least, most));
    }
    return value;
  }
  std::int64_t whole(const json& value, const std::string& where, std::int64_t low, std::int64_t high) const {
    const bool fits = value.is_number_unsigned()
                          ? value.get<std::uint64_t>() <= static_cast<std::uint64_t>(std::max<std::int64_t>(high, 0))
                          : value.is_number_integer();
    if (!fits || value.get<std::int64_t>() < low || value.get<std::int64_t>() > high) {
      reject(where, fmt::format("a whole number from {} to {}", low, high));
    }
    return value.get<std::int64_t>();
  }
  std::vector<float> numbers(const char* name, std::size_t count) const {
    const auto bytes = from_base64(text(root_, name));
    if (!bytes || bytes->size() != count * sizeof(float)) {
      reject(fmt::format("/{}", name), fmt::format("{} float32 in base64", count));
    }
    std::vector<float> result(count);
    std::copy(bytes->begin(), bytes->end(), reinterpret_cast<std::uint8_t*>(result.data()));
    const bool sound =
        std::all_of(result.begin(), result.end(), [](float v) { return std::abs(v) <= kMaxUnitComponent; });
    if (!sound) reject(fmt::format("/{}", name), "numbers between -1 and 1");
    return result;
  }
  void read_chunks(PlaceTable& table) const {
    const json& chunks = list(root_, "chunks", 0, kMaxPlaceChunks);
    const std::int64_t last_tile = (std::int64_t{1} << table.zoom) - 1;
    table.chunks.reserve(chunks.size());
    for (std::size_t i = 0; i < chunks.size(); ++i) {
      const json& row = chunks[i];
      const std::string where = fmt::format("/chunks/{}", i);
      if (!row.is_array() || row.size() != 4) reject(where, "lon_e7, lat_e7, tile x, tile y");
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
    if (next != table.chunks.size()) reject("/layers", fmt::format("{} chunks in all", table.chunks.size()));
  }

  const json& root_;
  std::string_view name_;
};

// What FAISS 1.7 writes for a flat index: "IxFI", dimension, number of vectors, two unused numbers, whether it is
// trained, metric; then the number of floats, and the floats.
constexpr std::size_t kHeader = 4 + 4 + 8 + 8 + 8 + 1 + 4;
constexpr std::size_t kPrefix = kHeader + 8;

// FAISS hands 20 queries or more to BLAS, whose sums depend on the implementation; fewer are computed one by one.
constexpr std::size_t kBatch = 16;

template <typename T>
T number_at(ByteView bytes, std::size_t at) {
  T value{};
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

void check_form(ByteView file, std::size_t count, std::string_view name) {
  const auto reject = [&](std::string expected, std::string found) {
    throw Error({.what = "not a place index",
                 .where = std::string(name),
                 .expected = std::move(expected),
                 .found = std::move(found),
                 .fix = "rebuild it with `nadir cache index`"});
  };
  const std::size_t size = kPrefix + count * kPlaceSize * sizeof(float);
  if (file.size() != size) reject(fmt::format("{} bytes", size), fmt::format("{} bytes", file.size()));
  if (as_text(file.first(4)) != "IxFI") reject("a flat index of inner products (IxFI)", "another kind of index");
  const auto dimension = number_at<std::int32_t>(file, 4);
  if (dimension != static_cast<std::int32_t>(kPlaceSize)) {
    reject(fmt::format("vectors of {} numbers", kPlaceSize), std::to_string(dimension));
  }
  const auto vectors = number_at<std::int64_t>(file, 8);
  const auto floats = number_at<std::uint64_t>(file, kHeader);
  if (vectors != static_cast<std::int64_t>(count) || floats != count * kPlaceSize) {
    reject(fmt::format("{} vectors", count), fmt::format("{} vectors, {} numbers", vectors, floats));
  }
  if (number_at<std::uint8_t>(file, 32) != 1 || number_at<std::int32_t>(file, 33) != faiss::METRIC_INNER_PRODUCT) {
    reject("a trained index of inner products", "another one");
  }
}

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
    throw Error({.what = "table of places is too large",
                 .where = std::string(name),
                 .expected = fmt::format("at most {} bytes", kMaxPlaceTableSize),
                 .found = fmt::format("{} bytes", text.size())});
  }
  const json document = parse_json(text, name, {.max_depth = 4, .allow_floats = false});
  return Reader(document, name).read();
}

struct PlaceVectors::Impl {
  faiss::IndexFlatIP index{static_cast<faiss::Index::idx_t>(kPlaceSize)};
};

PlaceVectors::PlaceVectors(std::span<const PlaceVector> vectors) : impl_(std::make_unique<Impl>()) {
  impl_->index.add(static_cast<faiss::Index::idx_t>(vectors.size()), vectors.empty() ? nullptr : vectors[0].data());
}

PlaceVectors::PlaceVectors(ByteView file, std::size_t count, std::string_view name) : impl_(std::make_unique<Impl>()) {
  check_form(file, count, name);
  try {
    faiss::VectorIOReader reader;
    reader.data.assign(file.begin(), file.end());
    const std::unique_ptr<faiss::Index> read(faiss::read_index(&reader));
    auto* flat = dynamic_cast<faiss::IndexFlatIP*>(read.get());
    if (flat == nullptr) throw Error({.what = "not a flat index", .where = std::string(name)});
    impl_->index = std::move(*flat);
  } catch (const faiss::FaissException& error) {
    throw Error({.what = "FAISS cannot read the place index", .where = std::string(name), .found = error.what()});
  }
  const std::span<const float> all(impl_->index.get_xb(), count * kPlaceSize);
  const bool sound =
      std::all_of(all.begin(), all.end(), [](float v) { return v >= -kMaxUnitComponent && v <= kMaxUnitComponent; });
  if (!sound) {  // NaN is not sound either
    throw Error({.what = "place index holds impossible numbers",
                 .where = std::string(name),
                 .expected = "vectors of length 1",
                 .found = "components beyond 1, or not numbers"});
  }
}

PlaceVectors::~PlaceVectors() = default;
PlaceVectors::PlaceVectors(PlaceVectors&&) noexcept = default;
PlaceVectors& PlaceVectors::operator=(PlaceVectors&&) noexcept = default;

Bytes PlaceVectors::file() const {
  faiss::VectorIOWriter writer;
  faiss::write_index(&impl_->index, &writer);
  return writer.data;
}

std::size_t PlaceVectors::size() const { return static_cast<std::size_t>(impl_->index.ntotal); }

std::span<const float> PlaceVectors::vector(std::size_t index) const {
  return {impl_->index.get_xb() + index * kPlaceSize, kPlaceSize};
}

std::vector<std::vector<PlaceVectors::Hit>> PlaceVectors::search(std::span<const PlaceVector> queries,
                                                                 std::size_t first, std::size_t count, std::size_t best,
                                                                 const Cancel& cancel) const {
  best = std::min(best, count);
  std::vector<std::vector<Hit>> result(queries.size());
  if (best == 0) return result;
  using Id = faiss::Index::idx_t;
  faiss::IDSelectorRange range(static_cast<Id>(first), static_cast<Id>(first + count));
  faiss::SearchParameters parameters;
  parameters.sel = &range;
  const bool whole = count == size();
  std::vector<float> scores(kBatch * best);
  std::vector<Id> labels(kBatch * best);
  for (std::size_t begin = 0; begin < queries.size(); begin += kBatch) {
    cancel.check();
    const std::size_t n = std::min(kBatch, queries.size() - begin);
    impl_->index.search(static_cast<Id>(n), queries[begin].data(), static_cast<Id>(best), scores.data(), labels.data(),
                        whole ? nullptr : &parameters);
    for (std::size_t q = 0; q < n; ++q) {
      for (std::size_t k = 0; k < best; ++k) {
        const Id label = labels[q * best + k];
        if (label >= 0) result[begin + q].push_back({static_cast<std::size_t>(label), scores[q * best + k]});
      }
    }
  }
  return result;
}

}  // namespace nadir
