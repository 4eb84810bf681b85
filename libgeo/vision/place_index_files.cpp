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

#include "base/bytes.hpp"
#include "base/error.hpp"
#include "base/json.hpp"
#include "base/printable.hpp"

namespace nadir {
namespace {

using nlohmann::json;

static_assert(std::endian::native == std::endian::little, "numbers are stored as little-endian float32");

std::string packed(std::span<const float> numbers) {
  return to_base64({reinterpret_cast<const std::uint8_t*>(numbers.data()), numbers.size_bytes()});
}

constexpr std::int64_t kLon_e7 = 1'800'000'000;
constexpr std::int64_t kLat_e7 = 900'000'000;

std::vector<float> read_floats(const JsonReader& in, const char* name, std::size_t count) {
  const auto bytes = from_base64(in.text(name));
  if (!bytes || bytes->size() != count * sizeof(float)) in.refuse(name, fmt::format("{} float32 in base64", count));
  std::vector<float> result(count);
  std::copy(bytes->begin(), bytes->end(), reinterpret_cast<std::uint8_t*>(result.data()));
  const bool sound =
      std::all_of(result.begin(), result.end(), [](float v) { return std::abs(v) <= kMaxUnitComponent; });
  if (!sound) in.refuse(name, "numbers between -1 and 1");
  return result;
}

void read_chunks(const JsonReader& chunks, PlaceTable& table) {
  const std::int64_t last_tile = (std::int64_t{1} << table.zoom) - 1;
  table.chunks.reserve(chunks.size());
  for (std::size_t i = 0; i < chunks.size(); ++i) {
    const JsonReader row = chunks.array(i, {.least = 4, .most = 4});
    PlaceChunk chunk;
    chunk.lon_e7 = row.integer(0, -kLon_e7, kLon_e7);
    chunk.lat_e7 = row.integer(1, -kLat_e7, kLat_e7);
    chunk.tile = {static_cast<std::uint8_t>(table.zoom), static_cast<std::uint32_t>(row.integer(2, 0, last_tile)),
                  static_cast<std::uint32_t>(row.integer(3, 0, last_tile))};
    table.chunks.push_back(chunk);
  }
}

void read_layers(const JsonReader& layers, PlaceTable& table) {
  std::size_t next = 0;
  for (std::size_t i = 0; i < layers.size(); ++i) {
    const JsonReader in = layers.object(i);
    PlaceLayer layer;
    layer.side_mm = in.integer("side_mm", 1000, 100'000'000);
    layer.side_px = in.integer("side_px", 32, 256);
    layer.first = next;
    const std::size_t left = table.chunks.size() - next;
    layer.count = in.integer<std::size_t>("count", 0, left);
    layer.textureless = in.integer<std::size_t>("textureless", 0, std::size_t{1} << 40);
    layer.invalid = in.integer<std::size_t>("invalid", 0, std::size_t{1} << 40);
    in.finish();
    next += layer.count;
    table.layers.push_back(layer);
  }
  if (next != table.chunks.size()) layers.refuse(fmt::format("{} chunks in all", table.chunks.size()));
}

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
  const JsonReader in(
      document,
      {.name = std::string(name), .what = "not a table of places", .fix = "rebuild it with `nadir cache index`"});
  in.expect("schema", kPlaceTableSchema);
  // A sound table of another descriptor: its vectors cannot be compared with those that are made here.
  if (const std::string& descriptor = in.text("descriptor", {.least = 1, .most = 100});
      descriptor != kPlaceDescriptorName) {
    throw Error({.what = "the place index was made with a descriptor that this version does not know",
                 .where = in.where("descriptor"),
                 .expected = fmt::format("\"{}\"", kPlaceDescriptorName),
                 .found = fmt::format("\"{}\"", printable(descriptor)),
                 .fix = "rebuild it with `nadir cache index`, or use the version that made it"});
  }
  PlaceTable table;
  table.imagery_root = in.digest("imagery_merkle_root");
  const JsonReader origin = in.array("origin_e7", {.least = 2, .most = 2});
  table.origin_lon_e7 = origin.integer(0, -kLon_e7, kLon_e7);
  table.origin_lat_e7 = origin.integer(1, -kLat_e7, kLat_e7);
  table.overlap_percent = in.integer("overlap_percent", 0, 90);
  table.zoom = in.integer("zoom", 0, kMaxZoom);
  table.projection.mean = read_floats(in, "mean", kRawPlaceSize);
  table.projection.basis = read_floats(in, "basis", kRawPlaceSize * kPlaceSize);
  table.projection.kept = static_cast<double>(in.integer("kept_ppm", 0, 1'000'000)) / 1e6;
  read_chunks(in.array("chunks", {.most = kMaxPlaceChunks}), table);
  read_layers(in.array("layers", {.least = 1, .most = kMaxPlaceLayers}), table);
  in.finish();
  return table;
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
  if (!sound) {  // NaN is invalid, too
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
