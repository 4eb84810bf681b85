#include "commands/ortho/compare_page.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>

#include "base/bytes.hpp"
#include "cli/nadir_version.hpp"
#include "imagery/codecs.hpp"
#include "imagery/map_window.hpp"
#include "report/page_text.hpp"

namespace nadir {
namespace {

constexpr double kMaxPixels = 1800;  // longer side of the images
constexpr double kLeastGsd_m = 0.1;
constexpr int kMapQuality = 80, kFlightQuality = 82;
const cv::Scalar kNoMap(46, 38, 32);  // BGR

std::string data_uri(const cv::Mat& picture, ImageFormat format, int quality) {
  return "data:image/" + std::string(name_of(format)) + ";base64," + to_base64(encode_image(picture, format, quality));
}

nlohmann::json pairs(const Figures& figures) {
  nlohmann::json list = nlohmann::json::array();
  for (const auto& [name, value] : figures) list.push_back({name, value});
  return list;
}

}  // namespace

std::string compare_page(const ComparePage& page, const TileSource& map, const TileSource& flight,
                         const LocalFrame& frame, const PlaneBox& box) {
  const double side_m = std::max(box.east_m - box.west_m, box.north_m - box.south_m);
  const double gsd_m = std::max(kLeastGsd_m, side_m / kMaxPixels);
  MapWindow before = read_map_window(map, frame, box, gsd_m, Colour::bgr);
  before.image.setTo(kNoMap, before.mask == 0);
  const MapWindow after = read_map_window(flight, frame, box, gsd_m, Colour::bgr);
  cv::Mat seen;
  cv::cvtColor(after.image, seen, cv::COLOR_BGR2BGRA);
  cv::insertChannel(after.mask, seen, 3);
  const nlohmann::json data{
      {"title", page.title},
      {"subtitle", page.subtitle},
      {"before", data_uri(before.image, ImageFormat::jpeg, kMapQuality)},
      {"after", data_uri(seen, ImageFormat::webp, kFlightQuality)},
      {"headline", pairs(page.headline)},
      {"figures", pairs(page.figures)},
      {"note",
       "Both images show the same ground at the same scale. Where roads and field borders continue across the "
       "slider, the tiles agree with the map."},
      {"footer", std::string("nadir ") + kVersion}};
  return fill_page(compare_page_text::html, {{"title", html_escaped(page.title)},
                                             {"style", compare_page_text::style},
                                             {"data", script_safe(data)},
                                             {"script", compare_page_text::script}});
}

}  // namespace nadir
