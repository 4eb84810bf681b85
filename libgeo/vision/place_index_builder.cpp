#include "vision/place_index_builder.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <numbers>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/ordered_work.hpp"
#include "base/random.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {
namespace {

// How many views train the projection besides the chunks themselves.
std::size_t training_views(std::size_t chunks) {
  return std::clamp(kTrainingViewsPerChunk * chunks, kMinTrainingViews, kMaxTrainingViews);
}

std::int64_t e7(double degrees) { return std::llround(degrees * 1e7); }

PlaceLayer layer_of(std::size_t number, const IndexedMap& map, const PlaceIndexOptions& options) {
  const double footprint_m = options.footprints_m[number];
  PlaceLayer layer;
  layer.side_mm = std::llround(footprint_m * 1000);
  if (number < options.sides_px.size()) {
    layer.side_px = options.sides_px[number];
    return layer;
  }
  const double map_gsd_m = ground_resolution_m(map.keys.front().z, map.origin.lat_deg);
  const double wanted = footprint_m / options.gsd_m.value_or(std::max(map_gsd_m, footprint_m / kPlacePatch_px));
  const double side_px = std::clamp(std::floor(wanted + kPatchRounding_px), 1.0, kMaxPlacePatch_px);
  if (side_px < kMinPlacePatch_px) {
    throw UsageError({.what = "chunks of this size show too little of this map",
                      .where = fmt::format("{:.0f} m", footprint_m),
                      .expected = fmt::format("at least {} pixels a side", kMinPlacePatch_px),
                      .found = fmt::format("{:.0f} at {:.2f} m per pixel", side_px, footprint_m / wanted),
                      .fix = "index a larger footprint (--footprint-m), or a finer map"});
  }
  layer.side_px = static_cast<std::int64_t>(side_px);
  return layer;
}

PlaneBox box_of(const IndexedMap& map, const LocalFrame& frame) {
  PlaneBox box{1e9, 1e9, -1e9, -1e9};
  for (const TileKey& key : map.keys) {
    const LonLatBox tile = bounds_of(key);
    for (const LonLat corner : {LonLat{tile.west_deg, tile.south_deg}, LonLat{tile.east_deg, tile.north_deg}}) {
      const PlanePoint at = frame.plane_from_lonlat(corner);
      box.west_m = std::min(box.west_m, at.east_m), box.east_m = std::max(box.east_m, at.east_m);
      box.south_m = std::min(box.south_m, at.north_m), box.north_m = std::max(box.north_m, at.north_m);
    }
  }
  return box;
}

// Middles of a layer's chunks: a grid around the origin, so that neighbouring packages share it; those on tiles alone.
std::vector<PlaceChunk> lay_out(const IndexedMap& map, const LocalFrame& frame, const PlaceLayer& layer, int overlap) {
  const double stride_m = layer.side_m() * (100 - overlap) / 100;
  const PlaneBox box = box_of(map, frame);
  const auto first = [stride_m](double low) { return static_cast<std::int64_t>(std::ceil(low / stride_m)); };
  const auto last = [stride_m](double high) { return static_cast<std::int64_t>(std::floor(high / stride_m)); };
  std::vector<PlaceChunk> chunks;
  for (std::int64_t row = first(box.south_m); row <= last(box.north_m); ++row) {
    for (std::int64_t column = first(box.west_m); column <= last(box.east_m); ++column) {
      const LonLat place =
          frame.lonlat_from_plane({static_cast<double>(column) * stride_m, static_cast<double>(row) * stride_m});
      PlaceChunk chunk{e7(place.lon_deg), e7(place.lat_deg), {}};
      chunk.tile = tile_at(chunk.centre(), map.keys.front().z);
      if (!std::binary_search(map.keys.begin(), map.keys.end(), chunk.tile)) continue;
      chunks.push_back(chunk);
      if (chunks.size() > kMaxPlaceChunks) {
        throw UsageError({.what = "too many chunks for one index",
                          .expected = fmt::format("at most {}", kMaxPlaceChunks),
                          .found = fmt::format("more, {:.0f} m wide", layer.side_m()),
                          .fix = "index a larger footprint (--footprint-m) or overlap less (--overlap-percent)"});
      }
    }
  }
  return chunks;
}

double valid_share(const cv::Mat& mask) { return cv::countNonZero(mask) / static_cast<double>(mask.total()); }

DescribedChunk describe(const PlacePatch& patch) {
  if (valid_share(patch.mask) < kMinChunkValid) return {};
  if (texture_of(patch) < kMinPlaceTexture) return {.valid = true};
  return {.valid = true, .descriptor = describe_place(patch)};
}

// A view of the map as a frame may show it.
struct View {
  std::size_t chunk = 0;
  const PlaceLayer* layer = nullptr;
  PatchPlacement placement;
};

std::vector<View> draw_views(const PlaceTable& table) {
  Random random = Random(1).fork("place index training");
  std::vector<View> views(training_views(table.chunks.size()));
  for (View& view : views) {
    view.chunk = static_cast<std::size_t>(random.uniform() * static_cast<double>(table.chunks.size()));
    view.layer = &*std::find_if(table.layers.begin(), table.layers.end(),
                                [&](const auto& one) { return view.chunk < one.first + one.count; });
    const double side_px = static_cast<double>(view.layer->side_px);
    view.placement.shift_px = {random.uniform(-kTrainingShift, kTrainingShift) * side_px,
                               random.uniform(-kTrainingShift, kTrainingShift) * side_px};
    view.placement.turn_rad = random.uniform(0, 2 * std::numbers::pi);
    view.placement.pixels_per_px = random.uniform(kMinTrainingScale, kMaxTrainingScale);
    view.placement.side_px = static_cast<int>(view.layer->side_px);
  }
  return views;
}

// Numbers of the views around one chunk each: they are cut from the same window of the map, and neighbouring chunks
// share decoded tiles.
std::vector<std::vector<std::size_t>> by_chunk(const std::vector<View>& views) {
  std::map<std::size_t, std::vector<std::size_t>> found;
  for (std::size_t i = 0; i < views.size(); ++i) found[views[i].chunk].push_back(i);
  std::vector<std::vector<std::size_t>> groups;
  for (auto& [chunk, numbers] : found) groups.push_back(std::move(numbers));
  return groups;
}

std::vector<DescribedChunk> describe_around(ChunkReader& reader, const PlaceTable& table,
                                            const std::vector<View>& views, const std::vector<std::size_t>& numbers) {
  const View& first = views[numbers.front()];
  const MapWindow window = reader.around(*first.layer, table.chunks[first.chunk], kTrainingWindow);
  const PatchCutter cutter(window.image, window.mask, 1);
  std::vector<DescribedChunk> described;
  for (const std::size_t number : numbers) {
    PatchPlacement placement = views[number].placement;
    placement.centre = {window.image.cols / 2.0, window.image.rows / 2.0};
    described.push_back(describe(cutter.cut(placement)));
  }
  return described;
}

enum ChunkKind : std::uint8_t { kInvalid = 0, kTextureless = 1, kDescribed = 2 };

}  // namespace

Bytes serialize_chunks(const std::vector<DescribedChunk>& chunks) {
  Bytes bytes;
  for (const DescribedChunk& chunk : chunks) {
    bytes.push_back(chunk.descriptor ? kDescribed : chunk.valid ? kTextureless : kInvalid);
    if (!chunk.descriptor) continue;
    for (const float value : *chunk.descriptor) {
      const auto bits = std::bit_cast<std::uint32_t>(value);
      for (int shift = 0; shift < 32; shift += 8) bytes.push_back(static_cast<std::uint8_t>(bits >> shift));
    }
  }
  return bytes;
}

std::optional<std::vector<DescribedChunk>> parse_chunks(ByteView bytes, std::size_t count) {
  std::vector<DescribedChunk> chunks;
  for (std::size_t i = 0; i < count; ++i) {
    if (bytes.empty() || bytes[0] > kDescribed) return std::nullopt;
    DescribedChunk& chunk = chunks.emplace_back();
    chunk.valid = bytes[0] != kInvalid;
    const bool described = bytes[0] == kDescribed;
    bytes = bytes.subspan(1);
    if (!described) continue;
    if (bytes.size() < 4 * kRawPlaceSize) return std::nullopt;
    for (float& value : chunk.descriptor.emplace()) {
      std::uint32_t bits = 0;
      for (std::size_t byte = 4; byte > 0; --byte) bits = bits << 8 | bytes[byte - 1];
      value = std::bit_cast<float>(bits);
      if (!std::isfinite(value)) return std::nullopt;
      bytes = bytes.subspan(4);
    }
  }
  return bytes.empty() ? std::optional(std::move(chunks)) : std::nullopt;
}

PlaceIndexBuilder::PlaceIndexBuilder(const IndexedMap& map, const PlaceIndexOptions& options)
    : map_(map), options_(options) {
  table_.imagery_root = map.merkle_root;
  table_.origin_lon_e7 = e7(map.origin.lon_deg);
  table_.origin_lat_e7 = e7(map.origin.lat_deg);
  table_.overlap_percent = options.overlap_percent;
  table_.zoom = map.keys.front().z;
  const LocalFrame frame(table_.origin());
  for (std::size_t i = 0; i < options.footprints_m.size(); ++i) {
    const PlaceLayer layer = layer_of(i, map, options);
    const std::vector<PlaceChunk> chunks = lay_out(map, frame, layer, options.overlap_percent);
    for (std::size_t first = 0; first < chunks.size(); first += kChunksPerTask) {
      const auto begin = chunks.begin() + static_cast<std::ptrdiff_t>(first);
      const std::size_t count = std::min(kChunksPerTask, chunks.size() - first);
      runs_.push_back({i, {begin, begin + static_cast<std::ptrdiff_t>(count)}});
    }
    table_.layers.push_back(layer);
  }
}

std::string PlaceIndexBuilder::description() const {
  std::string text = fmt::format("places: {}, imagery {}, zoom {}, origin {} {}, overlap {} %\n", kPlaceDescriptorName,
                                 table_.imagery_root.hex(), table_.zoom, table_.origin_lon_e7, table_.origin_lat_e7,
                                 table_.overlap_percent);
  for (const PlaceLayer& layer : table_.layers) {
    text += fmt::format("layer: {} mm in {} pixels\n", layer.side_mm, layer.side_px);
  }
  return text;
}

SharedWork::Worker PlaceIndexBuilder::make_worker() const {
  return [this, reader = std::make_shared<ChunkReader>(*map_.tiles, table_.origin())](std::size_t task) {
    const Run& run = runs_[task];
    std::vector<DescribedChunk> described;
    for (const PlaceChunk& chunk : run.chunks)
      described.push_back(describe(reader->read(table_.layers[run.layer], chunk)));
    return serialize_chunks(described);
  };
}

bool PlaceIndexBuilder::add(std::size_t task, ByteView result) {
  const Run& run = runs_[task];
  const auto described = parse_chunks(result, run.chunks.size());
  if (!described) return false;
  PlaceLayer& layer = table_.layers[run.layer];
  for (std::size_t i = 0; i < run.chunks.size(); ++i) {
    const DescribedChunk& chunk = (*described)[i];
    if (!chunk.descriptor) {
      ++(chunk.valid ? layer.textureless : layer.invalid);
      continue;
    }
    if (table_.chunks.size() == kMaxPlaceChunks) throw UsageError({.what = "too many chunks for one index"});
    ++layer.count;
    table_.chunks.push_back(run.chunks[i]);
    descriptors_.push_back(*chunk.descriptor);
  }
  return true;
}

PlaceIndex PlaceIndexBuilder::finish(Progress& progress) {
  if (descriptors_.empty()) {
    throw UsageError({.what = "the map has nothing to index",
                      .expected = "ground with some texture",
                      .found = "no chunk that is half covered and has texture"});
  }
  std::size_t first = 0;
  for (PlaceLayer& layer : table_.layers) {
    layer.first = first;
    first += layer.count;
  }
  table_.projection = train_projection(training_set(progress));
  std::vector<PlaceVector> vectors;
  vectors.reserve(descriptors_.size());
  for (const RawPlaceDescriptor& descriptor : descriptors_) vectors.push_back(table_.projection.project(descriptor));
  PlaceVectors index(vectors);
  return {std::move(table_), std::move(index)};
}

// The chunks, and views of the map as a frame may show it: anywhere, turned, a little larger or smaller.
std::vector<RawPlaceDescriptor> PlaceIndexBuilder::training_set(Progress& progress) const {
  std::vector<RawPlaceDescriptor> samples;
  const std::size_t step = descriptors_.size() / kTrainingChunks + 1;
  for (std::size_t i = 0; i < descriptors_.size(); i += step) samples.push_back(descriptors_[i]);
  const std::vector<View> views = draw_views(table_);
  const std::vector<std::vector<std::size_t>> groups = by_chunk(views);
  std::vector<DescribedChunk> seen(views.size());
  progress.begin("training the projection", views.size(), "views");
  work_in_order<std::vector<DescribedChunk>>(
      groups.size(), options_.threads,
      [&]() -> std::function<std::vector<DescribedChunk>(std::size_t)> {
        const auto reader = std::make_shared<ChunkReader>(*map_.tiles, table_.origin());
        return [&, reader](std::size_t group) { return describe_around(*reader, table_, views, groups[group]); };
      },
      [&](std::size_t group, std::vector<DescribedChunk> described) {
        for (std::size_t i = 0; i < described.size(); ++i) {
          seen[groups[group][i]] = std::move(described[i]);
          progress.advance();
        }
        return true;
      });
  progress.end();
  // In the order in which they were drawn, whatever chunk they are around: the sums' last bits depend on it.
  for (const DescribedChunk& view : seen) {
    if (view.descriptor) samples.push_back(*view.descriptor);
  }
  return samples;
}

double place_footprint_m(double width_m, double height_m) { return std::sqrt(width_m * height_m); }

PlaceIndex build_place_index(const IndexedMap& map, const PlaceIndexOptions& options, Progress& progress) {
  PlaceIndexBuilder builder(map, options);
  do_alone(builder, options.threads, progress);
  return builder.finish(progress);
}

}  // namespace nadir
