// Where on the whole map could this picture have been taken? The place index of a package answers within a fraction of
// a second, for a cold start or after tracking was lost; the correlator (place_search.hpp) then decides.
//
// One vector per chunk of the map. A picture is described at nine small shifts (chunks lie a quarter or a half of a
// side apart, and the descriptor forgives a sixth) for every heading that is possible; a chunk's score is the best of
// them.
//
// Everything is deterministic. Memory: the file's 512 bytes per chunk, the table's 32, and per query some megabytes.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "package/manifest.hpp"
#include "vision/place_table.hpp"
#include "vision/place_vectors.hpp"

namespace nadir {

// A picture as rectify() makes it, north-up under an assumed heading.
struct PlaceQuery {
  cv::Mat grey;  // CV_8UC1
  cv::Mat mask;  // CV_8UC1, 255 where the frame saw the ground
  double gsd_m = 1;
  // The true heading lies within ± this of the assumed one, three sigma or more. Nothing: unknown; 24 are tried.
  std::optional<double> heading_range_rad;
};

struct PlaceCandidate {
  std::size_t chunk = 0;  // of PlaceTable::chunks
  LonLat centre;          // of the chunk
  double side_m = 0;      // of the chunk, whose sides run north and east
  double score = -1;      // cosine, at most 1
  double turn_rad = 0;    // to be added to the assumed heading
  // The middle of the query's picture from the chunk's centre, good to a sixth of a side.
  double east_m = 0;
  double north_m = 0;
};

class PlaceIndex {
 public:
  PlaceIndex(PlaceTable table, PlaceVectors vectors);

  // Nothing when the manifest names no index. Both files must have the digests of the manifest and belong to its
  // imagery; else throws Error, before FAISS sees a byte.
  static std::optional<PlaceIndex> open(const std::filesystem::path& package, const Manifest& manifest);

  // The `count` best chunks, best first; none when the picture shows too little. The layer whose chunks are nearest in
  // size to what the mask shows is searched.
  std::vector<PlaceCandidate> query(const PlaceQuery& query, std::size_t count) const;

  const PlaceTable& table() const { return table_; }
  const PlaceVectors& vectors() const { return vectors_; }

 private:
  const PlaceLayer* layer_for(double side_m) const;  // null: no layer has chunks

  PlaceTable table_;
  PlaceVectors vectors_;
};

}  // namespace nadir
