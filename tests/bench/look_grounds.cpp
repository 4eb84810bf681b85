#include "look_grounds.hpp"

#include <fmt/format.h>
#include <gdal_priv.h>

#include <cmath>
#include <cstdlib>
#include <opencv2/imgproc.hpp>

#include "base/csv.hpp"
#include "base/error.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"

namespace nadir::bench {
namespace {

constexpr double kAssumedPairGsd_m = 0.75;  // nobody states it; 0.5 to 1
constexpr int kLeastPairInliers = 50;       // fewer: the transform of the pair is doubtful
constexpr double kNaipGsd_m = 5;

struct Raster {
  cv::Mat bgr;
  double transform[6];  // GDAL's: x = [0] + column [1], y = [3] + row [5]
};

Raster read_raster(const std::filesystem::path& path) {
  GDALAllRegister();
  const std::unique_ptr<GDALDataset> set(GDALDataset::Open(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY));
  Raster raster;
  if (set == nullptr || set->GetRasterCount() < 3 || set->GetGeoTransform(raster.transform) != CE_None) {
    throw Error({.what = "not a georeferenced picture of three bands", .where = path.string()});
  }
  const int width = set->GetRasterXSize(), height = set->GetRasterYSize();
  raster.bgr.create(height, width, CV_8UC3);
  int bands[] = {3, 2, 1};
  if (set->RasterIO(GF_Read, 0, 0, width, height, raster.bgr.data, width, height, GDT_Byte, 3, bands, 3,
                    static_cast<GSpacing>(raster.bgr.step), 1, nullptr) != CE_None) {
    throw Error({.what = "GDAL cannot read the picture", .where = path.string()});
  }
  return raster;
}

// A raster in Web Mercator, small enough that its scale is one.
struct MercatorRaster {
  Raster raster;
  double gsd_m = 0;

  explicit MercatorRaster(const std::filesystem::path& path) : raster(read_raster(path)) {
    const double middle_y = raster.transform[3] + raster.transform[5] * raster.bgr.rows / 2;
    gsd_m = raster.transform[1] / std::cosh(middle_y / kEarthRadius_m);  // cosh(asinh(tan lat)) = 1 / cos(lat)
  }
  // In the plane whose origin is the raster's middle.
  PlanePoint place_of(LonLat at) const {
    const double x = kEarthRadius_m * radians(at.lon_deg);
    const double y = kEarthRadius_m * std::asinh(std::tan(radians(at.lat_deg)));
    const double column = (x - raster.transform[0]) / raster.transform[1];
    const double row = (y - raster.transform[3]) / raster.transform[5];
    return {(column - raster.bgr.cols / 2.0) * gsd_m, (raster.bgr.rows / 2.0 - row) * gsd_m};
  }

 private:
  static constexpr double kEarthRadius_m = 6378137;
};

void add_maps(Ground& ground, int zoom) {
  const auto tiles = [&](MapOrientation orientation) {
    ground.owned.push_back(std::make_unique<PictureTiles>(
        ground.map_image, MapPlacement{.gsd_m = ground.map_gsd_m, .zoom = zoom, .orientation = orientation}));
    return ground.owned.back().get();
  };
  ground.map = tiles(MapOrientation::as_it_is);
  ground.mirrored = tiles(MapOrientation::mirrored);
  ground.turned = tiles(MapOrientation::quarter_turn);
  ground.width_m = ground.map_image.cols * ground.map_gsd_m;
  ground.height_m = ground.map_image.rows * ground.map_gsd_m;
}

std::vector<RecordedFrame> recorded_frames(const std::filesystem::path& folder, const MercatorRaster& map) {
  const CsvTable telemetry = CsvTable::read(folder / "telemetry.csv"), truth = CsvTable::read(folder / "truth.csv");
  const auto in = [](const CsvTable& table, const char* name) { return table.required_column(name); };
  std::vector<RecordedFrame> frames;
  for (std::size_t i = 0; i < telemetry.rows(); ++i) {
    for (std::size_t j = 0; j < truth.rows(); ++j) {
      if (truth.cell(j, in(truth, "frame")) != telemetry.cell(i, in(telemetry, "frame"))) continue;
      frames.push_back({folder / "frames" / telemetry.cell(i, in(telemetry, "frame")),
                        telemetry.required_number(i, in(telemetry, "agl_m")),
                        radians(telemetry.required_number(i, in(telemetry, "heading_deg"))),
                        map.place_of({truth.required_number(j, in(truth, "lon_deg")),
                                      truth.required_number(j, in(truth, "lat_deg"))})});
    }
  }
  return frames;
}

}  // namespace

Purpose purpose_of(std::uint64_t base_seed) {
  if (base_seed < 1000) return Purpose::train;
  if (base_seed >= 1'000'000) return Purpose::judge;
  throw UsageError({.what = "this base seed neither trains nor judges",
                    .expected = "below 1000 to train, 1000000 or more to judge",
                    .found = std::to_string(base_seed)});
}

std::uint64_t first_world(Purpose purpose) { return purpose == Purpose::train ? 1 : 1'000'001; }

Grounds::Grounds(Purpose purpose, int worlds, std::uint64_t first_world, const std::filesystem::path& data)
    : worlds_(worlds, first_world), first_world_(first_world) {
  add_painted();
  if (!data.empty()) {
    add_naip(purpose, data / "naip");
    add_pairs(purpose, data / "gearth_pairs");
    if (purpose == Purpose::judge) {
      add_arroio(data / "arroio");
      add_fengyuan(data / "fengyuan");
    }
  }
  find_others();
}

void Grounds::add_painted() {
  for (std::size_t i = 0; i < worlds_.all.size(); ++i) {
    World& world = *worlds_.all[i];
    Ground& ground = painted_.emplace_back();
    ground.name = ground.region = fmt::format("painted {}", first_world_ + i);
    ground.picture = world.day;
    ground.picture_gsd_m = kWorldGsd_m;
    ground.surface = &world.terrain;
    ground.map_image = world.satellite;
    ground.map_gsd_m = kWorldGsd_m;
    ground.camera = camera_file();
    add_maps(ground, kMapZoom);
    ground.old = worlds_.old_maps[i].get();
  }
}

// Flown 2009 over the map of 2015 and the reverse; for judging the same with 2018 and 2020.
void Grounds::add_naip(Purpose purpose, const std::filesystem::path& folder) {
  const bool train = purpose == Purpose::train;
  const std::array<std::string, 2> days =
      train ? std::array<std::string, 2>{"20090818", "20150926"} : std::array<std::string, 2>{"20180716", "20200831"};
  std::vector<cv::Mat> years;
  for (const std::string& day : days) {
    const auto path = folder / ("m_4709963_se_14_1_" + day + ".tif");
    if (!std::filesystem::exists(path)) return;
    const Raster raster = read_raster(path);
    // Onto the grid of the first: they are some metres apart.
    static constexpr double kWest_m = 485910, kNorth_m = 5209235;
    cv::Mat image;
    const cv::Matx23d from(1, 0, (kWest_m - raster.transform[0]) / kNaipGsd_m, 0, 1,
                           (raster.transform[3] - kNorth_m) / kNaipGsd_m);
    cv::warpAffine(raster.bgr, image, from, {928, 718}, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP, cv::BORDER_REPLICATE);
    years.push_back(image);
  }
  for (std::size_t i = 0; i < 2; ++i) {
    Ground& ground = real_.emplace_back();
    ground.name = fmt::format("naip {} {}", days[i].substr(0, 4), days[1 - i].substr(0, 4));
    ground.region = "naip";
    ground.picture = years[i];
    ground.map_image = years[1 - i];
    ground.picture_gsd_m = ground.map_gsd_m = kNaipGsd_m;
    ground.surface = &flat_;
    ground.camera = camera_file();
    ground.least_agl_m = 800, ground.largest_agl_m = 1800;
    ground.unit = 2.5;
    add_maps(ground, 15);
  }
}

// The second picture is the map, the first one is flown over, in the second's pixels.
void Grounds::add_pairs(Purpose purpose, const std::filesystem::path& folder) {
  if (!std::filesystem::exists(folder / "pairs.csv")) return;
  const CsvTable pairs = CsvTable::read(folder / "pairs.csv");
  std::size_t used = 0;
  for (std::size_t row = 0; row < pairs.rows(); ++row) {
    const std::string name = pairs.cell(row, pairs.required_column("pair"));
    const auto number = [&](const char* column) { return pairs.required_number(row, pairs.required_column(column)); };
    if (name.size() > 2 || number("inliers") < kLeastPairInliers) continue;  // 16_0 is 16 turned
    if ((used++ % 2 == 0) != (purpose == Purpose::train)) continue;
    const cv::Mat source = read_image_file(folder / (name + "_src.jpg"), Colour::bgr);
    Ground& ground = real_.emplace_back();
    ground.name = ground.region = "pair " + name;
    ground.map_image = read_image_file(folder / (name + "_tgt.jpg"), Colour::bgr);
    const cv::Matx23d to(number("a11"), number("a12"), number("a13"), number("a21"), number("a22"), number("a23"));
    cv::warpAffine(source, ground.picture, to, ground.map_image.size());
    cv::warpAffine(cv::Mat(source.size(), CV_8UC1, cv::Scalar(255)), ground.seen, to, ground.map_image.size(),
                   cv::INTER_NEAREST);
    ground.picture_gsd_m = ground.map_gsd_m = kAssumedPairGsd_m;
    ground.surface = &flat_;
    ground.camera = camera_file();
    ground.largest_agl_m = std::min(300.0, 0.35 * kAssumedPairGsd_m * ground.map_image.cols);
    add_maps(ground, 17);
  }
}

// Two months: each is the other's map; and the flight over each of them.
void Grounds::add_arroio(const std::filesystem::path& folder) {
  if (!std::filesystem::exists(folder / "camera.yaml")) return;
  const std::array<std::string, 2> months = {"2014-01", "2014-03"};
  const std::vector<MercatorRaster> maps = {MercatorRaster(folder / ("map_" + months[0] + ".tif")),
                                            MercatorRaster(folder / ("map_" + months[1] + ".tif"))};
  for (std::size_t i = 0; i < 2; ++i) {
    for (const bool flown : {false, true}) {
      Ground& ground = real_.emplace_back();
      ground.region = "arroio";
      ground.name = fmt::format("arroio {} {}", flown ? "flight" : months[1 - i], months[i]);
      ground.map_image = maps[i].raster.bgr;
      ground.map_gsd_m = ground.picture_gsd_m = maps[i].gsd_m;
      ground.surface = &flat_;
      if (flown) {
        ground.camera = read_camera_file(folder / "camera.yaml");
        ground.frames = recorded_frames(folder, maps[i]);
        ground.truth_is_picture_centre = true;
      } else {
        ground.camera = camera_file();
        ground.picture = maps[1 - i].raster.bgr;
        ground.largest_agl_m = 300;
      }
      add_maps(ground, 19);
    }
  }
}

void Grounds::add_fengyuan(const std::filesystem::path& folder) {
  if (!std::filesystem::exists(folder / "camera.yaml")) return;
  const MercatorRaster map(folder / "map.tif");
  Ground& ground = real_.emplace_back();
  ground.name = "fengyuan flight", ground.region = "fengyuan";
  ground.map_image = map.raster.bgr;
  ground.map_gsd_m = ground.picture_gsd_m = map.gsd_m;
  ground.surface = &flat_;
  ground.camera = read_camera_file(folder / "camera.yaml");
  ground.frames = recorded_frames(folder, map);
  add_maps(ground, 19);
}

void Grounds::find_others() {
  const std::size_t count = painted_.size() + real_.size();
  for (std::size_t i = 0; i < count; ++i) {
    Ground& ground = i < painted_.size() ? painted_[i] : real_[i - painted_.size()];
    for (std::size_t j = 0; j < count; ++j) {
      const double scale = at(j).map_gsd_m / ground.map_gsd_m;
      if (at(j).region != ground.region && scale > 0.2 && scale < 5) ground.others.push_back(j);
    }
  }
}

std::string Grounds::names() const {
  std::string list;
  for (std::size_t i = 0; i < painted_.size() + real_.size(); ++i) {
    list += (list.empty() ? "" : "; ") + at(i).name;
  }
  return list;
}

std::filesystem::path data_folder() {
  const char* named = std::getenv("NADIR_DATA");
  const std::filesystem::path folder = named != nullptr ? named : NADIR_SOURCE "/../shared/data";
  return std::filesystem::is_directory(folder) ? folder : std::filesystem::path();
}

}  // namespace nadir::bench
