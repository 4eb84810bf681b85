#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "imagery/map_window.hpp"
#include "replay/flight_map.hpp"
#include "replay/pictures.hpp"

namespace nadir {
namespace {

constexpr double kMargin_share = 0.35;  // of the track's longer side, so that there is something to pan to
constexpr double kMinMargin_m = 120;
constexpr double kShape = 1.7;       // width over height
constexpr double kMaxPixels = 1500;  // longer side of the picture
constexpr int kQuality = 70;
const cv::Scalar kNoMap(46, 38, 32);  // BGR

}  // namespace

std::optional<ReportMap> report_map(const TileSource& tiles, const LocalFrame& frame, PlaneBox track) {
  const double longer = std::max(track.east_m - track.west_m, track.north_m - track.south_m);
  const double margin = std::max(kMinMargin_m, kMargin_share * longer);
  PlaneBox box{track.west_m - margin, track.south_m - margin, track.east_m + margin, track.north_m + margin};
  // As wide as a laptop shows it.
  const double missing = std::max(0.0, kShape * (box.north_m - box.south_m) - (box.east_m - box.west_m)) / 2;
  box.west_m -= missing;
  box.east_m += missing;
  const double gsd_m = std::max(0.2, std::max(box.east_m - box.west_m, box.north_m - box.south_m) / kMaxPixels);
  const MapWindow window = read_map_window(tiles, frame, box, gsd_m, Colour::bgr);
  if (window.image.empty() || cv::countNonZero(window.mask) == 0) return std::nullopt;
  const cv::Rect covered = cv::boundingRect(window.mask);
  cv::Mat picture = window.image(covered).clone();
  picture.setTo(kNoMap, window.mask(covered) == 0);
  const PlanePoint corner = window.plane_from_pixel(covered.x, covered.y);
  return ReportMap{jpeg_data_uri(picture, static_cast<int>(kMaxPixels) + 2, kQuality), corner.east_m, corner.north_m,
                   window.gsd_m * picture.cols, window.gsd_m * picture.rows};
}

}  // namespace nadir
