// Builds the place index of a map: lays chunks over it, describes each, trains the projection on them.
//
// Describing is what grows with the map, and work that several machines may share; the projection is trained on a
// sample, on one.
#pragma once

#include <vector>

#include "base/digest.hpp"
#include "base/progress.hpp"
#include "base/shared_work.hpp"
#include "vision/place_index.hpp"

namespace nadir {

struct PlaceIndexOptions {
  std::vector<double> footprints_m;         // sides of the chunks, one layer each
  std::optional<double> gsd_m;              // of the patches; by default 96 pixels a side, not finer than the map
  int overlap_percent = 75;                 // of neighbouring chunks, along a side
  std::vector<std::int64_t> sides_px = {};  // of the patches, one for each footprint, instead of gsd_m
  int threads = 1;                          // the result does not depend on it
};

// The map that is indexed.
struct IndexedMap {
  const TileSource* tiles = nullptr;
  std::vector<TileKey> keys;  // of the finest zoom
  Sha256 merkle_root;
  LonLat origin;  // of the mission's plane
};

// What became of a chunk.
struct DescribedChunk {
  bool valid = false;  // enough of the patch shows ground
  std::optional<RawPlaceDescriptor> descriptor = std::nullopt;
};
// Some chunks as bytes: for each 0 (invalid), 1 (no texture), or 2 and the descriptor's numbers as IEEE 754 singles,
// little-endian. Nothing for bytes that are not exactly `count` chunks.
Bytes serialize_chunks(const std::vector<DescribedChunk>& chunks);
std::optional<std::vector<DescribedChunk>> parse_chunks(ByteView bytes, std::size_t count);

// A task is a run of neighbouring chunks, which share decoded tiles. Throws UsageError when there would be too many
// chunks.
class PlaceIndexBuilder final : public SharedWork {
 public:
  // map, options: must outlive it.
  PlaceIndexBuilder(const IndexedMap& map, const PlaceIndexOptions& options);

  std::string what() const override { return "describing places"; }
  std::string description() const override;
  std::size_t tasks() const override { return runs_.size(); }
  Worker make_worker() const override;
  bool add(std::size_t task, ByteView result) override;

  // After all results. Throws UsageError when no chunk is left.
  PlaceIndex finish(Progress& progress);

 private:
  struct Run {
    std::size_t layer = 0;
    std::vector<PlaceChunk> chunks;
  };
  std::vector<RawPlaceDescriptor> training_set(Progress& progress) const;

  const IndexedMap& map_;
  const PlaceIndexOptions& options_;
  std::vector<Run> runs_;  // layer by layer
  PlaceTable table_;
  std::vector<RawPlaceDescriptor> descriptors_;
};

// All of it here. The same map and options give the same bytes.
PlaceIndex build_place_index(const IndexedMap& map, const PlaceIndexOptions& options, Progress& progress);

// Side of the square that has the footprint's area.
double place_footprint_m(double width_m, double height_m);

}  // namespace nadir
