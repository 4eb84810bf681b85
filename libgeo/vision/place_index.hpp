// Where on the whole map could this frame have been taken? The place index of a package answers within a fraction of a
// second, for a cold start or after tracking was lost; correlation (map_search.hpp) then decides.
//
// One vector per chunk of the map. A frame is described at nine small shifts (chunks lie a quarter or a half of a side
// apart, and the descriptor tolerates a sixth) for every heading that is possible; a chunk's score is the best of them.
//
// Everything is deterministic. Memory: the file's 512 bytes per chunk, the table's 32, and per query some megabytes.
#pragma once

#include <optional>
#include <vector>

#include "base/error.hpp"
#include "base/input_file.hpp"
#include "base/progress.hpp"
#include "geodesy/local_frame.hpp"
#include "imagery/map_window.hpp"
#include "imagery/tile_source.hpp"
#include "package/manifest.hpp"
#include "package/open_package.hpp"
#include "package/verify.hpp"
#include "vision/map_search.hpp"
#include "vision/place_index_files.hpp"

namespace nadir {

class PlaceIndex final : public PlaceRetrieval {
 public:
  PlaceIndex(PlaceTable table, PlaceVectors vectors);

  // Nothing when the manifest names no index. Both files must have the digests of the manifest and belong to its
  // imagery; else throws Error, before FAISS sees a byte.
  static std::optional<PlaceIndex> open(const Directory& package, const Manifest& manifest);

  // The layer whose chunks are nearest in size to what the mask shows is searched.
  std::vector<PlaceCandidate> query(const PlaceQuery& query, std::size_t count) const override;

  const PlaceTable& table() const { return table_; }
  const PlaceVectors& vectors() const { return vectors_; }

 private:
  const PlaceLayer* layer_for(double side_m) const;  // null: no layer has chunks

  PlaceTable table_;
  PlaceVectors vectors_;
};

// Reads the patch of a chunk from the tiles, as the builder described it.
class ChunkReader {
 public:
  ChunkReader(const TileSource& tiles, LonLat origin);

  PlacePatch read(const PlaceLayer& layer, const PlaceChunk& chunk);
  // A larger piece around the chunk's middle, at the layer's GSD.
  MapWindow around(const PlaceLayer& layer, const PlaceChunk& chunk, double sides);

 private:
  LocalFrame frame_;
  MapWindowReader windows_;
};

// Whether the index of a package belongs to its imagery. package/verify.hpp has checked the files' bytes; their meaning
// can only be checked here, with the descriptor at hand.
//
// "index.mismatch": the table cannot be read, is for other imagery or another plane, or does not fit the vectors; at
// full depth also when a sample of the chunks (one in a hundred, 32 at least, drawn by the manifest's digest) is
// described again from the tiles and differs. No findings for a package without an index.
Findings check_place_index(const Directory& package, const Manifest& manifest, const Mission& mission,
                           const TileSource& tiles, VerifyDepth depth, Progress& progress);

// What every command runs in addition to verify_package() and open_package().
void verify_place_index(VerifyDepth depth, Progress& progress, Verification& verification);
void verify_place_index(VerifyDepth depth, Progress& progress, Opening& opening);

}  // namespace nadir
