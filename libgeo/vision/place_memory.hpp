// Who knows a map by heart and names places that may look like a picture. What is named is a suggestion: the correlator
// (place_search.hpp) and the gates decide. The place index of a package is one (place_index.hpp).
#pragma once

#include <cstddef>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "base/progress.hpp"
#include "geodesy/lon_lat.hpp"

namespace nadir {

// A picture as rectify() makes it, north-up under an assumed heading.
struct PlaceQuery {
  cv::Mat grey;  // CV_8UC1
  cv::Mat mask;  // CV_8UC1, 255 where the frame saw the ground
  double gsd_m = 1;
  // The true heading lies within ± this of the assumed one, three sigma or more. Nothing: unknown; 24 are tried.
  std::optional<double> heading_range_rad;
  Cancel cancel{};  // asked now and then
};

struct PlaceCandidate {
  std::size_t chunk = 0;  // which one, in the order of who recalls
  LonLat centre;          // of the chunk
  double side_m = 0;      // of the chunk, whose sides run north and east
  double score = -1;      // cosine, at most 1
  double turn_rad = 0;    // to be added to the assumed heading
  // The middle of the query's picture from the chunk's centre, good to a sixth of a side.
  double east_m = 0;
  double north_m = 0;
};

class PlaceRetrieval {
 public:
  virtual ~PlaceRetrieval() = default;
  // The `count` best chunks, best first; none when the picture shows too little.
  virtual std::vector<PlaceCandidate> query(const PlaceQuery& query, std::size_t count) const = 0;
};

}  // namespace nadir
