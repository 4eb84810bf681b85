#include "datasets/map_datasets.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gdal_priv.h>
#include <gdal_utils.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>

#include "base/csv.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "base/json.hpp"
#include "base/time.hpp"
#include "datasets/numpy_arrays.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/local_frame.hpp"
#include "imagery/codecs.hpp"
#include "imagery/frame_image.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/gdal_drivers.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

// ---- Tables

// DJI's tools write a plus sign, and NaN for what is unknown.
std::optional<double> number_of(const CsvTable& table, std::size_t row, std::size_t column) {
  const std::string& cell = table.cell(row, column);
  if (cell == "NaN" || cell == "nan") return std::nullopt;
  if (!cell.starts_with('+')) return table.number(row, column);
  const CsvTable unsigned_cell = CsvTable::parse("value\n" + cell.substr(1) + "\n", table.path());
  try {
    return unsigned_cell.number(0, 0);
  } catch (const Error& error) {
    throw Error({.what = error.text().what,
                 .where = table.where(row, column),
                 .expected = error.text().expected,
                 .found = cell});
  }
}

double number_within(const CsvTable& table, std::size_t row, std::size_t column, double low, double high) {
  const auto value = number_of(table, row, column);
  if (value && *value >= low && *value <= high) return *value;
  throw Error({.what = "a cell of the dataset does not hold what it should",
               .where = table.where(row, column),
               .expected = fmt::format("a number from {} to {}", low, high),
               .found = fmt::format("\"{}\"", table.cell(row, column))});
}

std::optional<double> angle_rad(const CsvTable& table, std::size_t row, std::optional<std::size_t> column) {
  if (!column || !number_of(table, row, *column)) return std::nullopt;
  return radians(number_within(table, row, *column, -360, 360));
}

LonLat place_in(const CsvTable& table, std::size_t row, std::size_t lat, std::size_t lon) {
  return {number_within(table, row, lon, -180, 180), number_within(table, row, lat, -85, 85)};
}

// A file named in a table, beneath `folder`.
fs::path file_named(const CsvTable& table, std::size_t row, std::size_t column, const fs::path& folder) {
  const std::string& name = table.cell(row, column);
  if (name.empty() || name.find('/') != std::string::npos || name == "." || name == "..") {
    throw Error({.what = "a cell of the dataset names no file of its folder",
                 .where = table.where(row, column),
                 .expected = "the name of a file in " + folder.string(),
                 .found = fmt::format("\"{}\"", name)});
  }
  if (!fs::is_regular_file(folder / name)) {
    throw Error({.what = "a picture of the dataset is missing",
                 .where = table.where(row, column),
                 .expected = (folder / name).string(),
                 .found = "no such file",
                 .fix = "unpack the dataset completely, or remove the row"});
  }
  return fs::absolute(folder / name);
}

fs::path need_file(const fs::path& path, std::string_view dataset) {
  if (fs::is_regular_file(path)) return path;
  throw UsageError({.what = fmt::format("this is no folder of {}", dataset),
                    .where = path.string(),
                    .expected = "this file",
                    .found = fs::exists(path) ? "no file" : "nothing"});
}

// ---- Choosing

std::vector<std::size_t> chosen(std::size_t count, const MapDatasetOptions& options) {
  const std::size_t most = std::min(count, options.max_frames.value_or(count));
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < most; ++i) rows.push_back(options.in_sequence ? i : i * count / most);
  return rows;
}

// Throws UsageError for names that the dataset does not have.
std::vector<std::string> wanted_flights(std::vector<std::string> there, const MapDatasetOptions& options,
                                        const fs::path& folder) {
  std::sort(there.begin(), there.end());
  if (there.empty()) {
    throw UsageError(
        {.what = "the dataset has no flights", .where = folder.string(), .fix = "check PATH and --dataset"});
  }
  if (options.flights.empty()) return there;
  for (const std::string& name : options.flights) {
    if (std::find(there.begin(), there.end(), name) == there.end()) {
      throw UsageError({.what = "the dataset has no such flight",
                        .where = "--flight",
                        .expected = fmt::format("{}", fmt::join(there, ", ")),
                        .found = name});
    }
  }
  return options.flights;
}

CameraFile stated_camera(const MapDatasetOptions& options, std::string_view dataset) {
  if (options.camera) return read_camera_file(*options.camera);
  throw UsageError({.what = fmt::format("{} does not say which camera its pictures are of", dataset),
                    .where = "--camera",
                    .expected = "a camera.yaml with the size of the pictures and their focal length in pixels",
                    .found = "none",
                    .fix = "width and height of the pictures; fx = fy = height above ground / ground sample distance"});
}

void check_size(const fs::path& picture, const CameraModel& camera) {
  const FrameSize size = read_frame_size(picture);
  if (size.width == camera.width && size.height == camera.height) return;
  throw UsageError({.what = "a picture of the dataset is not of this camera",
                    .where = picture.string(),
                    .expected = fmt::format("{}×{} pixels, as --camera states", camera.width, camera.height),
                    .found = fmt::format("{}×{}", size.width, size.height),
                    .fix = "give each flight its own camera: --flight NAME --camera FILE.yaml"});
}

void refuse_sequence(const MapDatasetOptions& options, std::string_view dataset) {
  if (!options.in_sequence) return;
  throw UsageError({.what = fmt::format("{} has no times", dataset),
                    .where = "--method flight",
                    .expected = "uav-visloc, whose tables have a date for each picture",
                    .fix = "leave it out: each frame is placed by itself"});
}

void add_frame(DatasetFlight& into, Telemetry telemetry, const fs::path& picture, LonLat truth) {
  if (into.flight.frames_folder.empty()) into.flight.frames_folder = picture.parent_path();
  into.flight.frames.push_back(std::move(telemetry));
  const bool beside = picture.parent_path() == into.flight.frames_folder;
  into.flight.files.push_back(beside ? picture.filename().string() : picture.string());
  into.truth.emplace_back(truth);
}

void refuse_empty(const DatasetFlight& flight, const fs::path& where) {
  if (!flight.flight.frames.empty()) return;
  throw Error({.what = "a flight of the dataset has no pictures", .where = where.string(), .found = "no rows"});
}

// ---- Maps

struct MapCorners {
  double west = 0, north = 0, east = 0, south = 0;  // in the units of the CRS
};

[[noreturn]] void fail_map(const fs::path& picture) {
  throw Error({.what = "GDAL cannot georeference a map of the dataset",
               .where = picture.string(),
               .found = QuietGdal::last_error()});
}

// GDAL's translation with its own options; nothing where the file cannot be opened.
void translate(const fs::path& from, const fs::path& to, const std::vector<std::string>& arguments) {
  const QuietGdal quiet;
  const GdalHandle source = open_gdal_raster(from);
  std::vector<char*> words;
  for (const std::string& word : arguments) words.push_back(const_cast<char*>(word.c_str()));
  words.push_back(nullptr);
  const std::unique_ptr<GDALTranslateOptions, decltype(&GDALTranslateOptionsFree)> options(
      GDALTranslateOptionsNew(words.data(), nullptr), &GDALTranslateOptionsFree);
  int misused = FALSE;
  const GdalHandle made(
      GDALDataset::FromHandle(GDALTranslate(to.c_str(), GDALDataset::ToHandle(source.get()), options.get(), &misused)));
  if (!made || misused != FALSE) fail_map(from);
}

bool is_georeferenced(const fs::path& map) {
  const QuietGdal quiet;
  const GdalHandle set = open_gdal_raster(map);
  double transform[6];
  const OGRSpatialReference* system = set->GetSpatialRef();
  return set->GetGeoTransform(transform) == CE_None && system != nullptr && !system->IsEmpty();
}

FrameSize raster_size(const fs::path& map) {
  const QuietGdal quiet;
  const GdalHandle set = open_gdal_raster(map);
  return {set->GetRasterXSize(), set->GetRasterYSize()};
}

// The picture with these corners. A TIFF is only described (VRT); a compressed picture becomes a tiled TIFF, because
// parts of it could be read only from its beginning.
fs::path georeferenced(const fs::path& picture, const std::string& crs, const MapCorners& corners,
                       const fs::path& work) {
  const std::string extension = picture.extension().string();
  const bool tiff = extension == ".tif" || extension == ".tiff" || extension == ".TIF";
  fs::path to = work / (picture.stem().string() + (tiff ? ".vrt" : ".tif"));
  std::vector<std::string> arguments{"-q", "-a_srs", crs, "-a_ullr"};
  for (const double value : {corners.west, corners.north, corners.east, corners.south}) {
    arguments.push_back(fmt::format("{:.12g}", value));
  }
  const std::vector<std::string> form =
      tiff ? std::vector<std::string>{"-of", "VRT"}
           : std::vector<std::string>{"-of", "GTiff",        "-co", "TILED=YES",
                                      "-co", "COMPRESS=LZW", "-co", "BIGTIFF=IF_SAFER"};
  arguments.insert(arguments.end(), form.begin(), form.end());
  translate(picture, to, arguments);
  return to;
}

fs::path joined(const std::vector<fs::path>& maps, const fs::path& to) {
  if (maps.size() == 1) return maps.front();
  const QuietGdal quiet;
  std::vector<std::string> names;
  for (const fs::path& map : maps) names.push_back(fs::absolute(map).string());
  std::vector<const char*> list;
  for (const std::string& name : names) list.push_back(name.c_str());
  std::array<char*, 4> words{const_cast<char*>("-q"), const_cast<char*>("-resolution"), const_cast<char*>("highest"),
                             nullptr};
  const std::unique_ptr<GDALBuildVRTOptions, decltype(&GDALBuildVRTOptionsFree)> options(
      GDALBuildVRTOptionsNew(words.data(), nullptr), &GDALBuildVRTOptionsFree);
  int misused = FALSE;
  const GdalHandle made(GDALDataset::FromHandle(
      GDALBuildVRT(to.c_str(), static_cast<int>(list.size()), nullptr, list.data(), options.get(), &misused)));
  if (!made || misused != FALSE) fail_map(to);
  return to;
}

constexpr const char* kWgs84 = "EPSG:4326";

MapCorners corners_in(const CsvTable& table, std::size_t row, const std::array<const char*, 4>& names) {
  MapCorners corners;
  const std::array<std::size_t, 4> columns{table.required_column(names[0]), table.required_column(names[1]),
                                           table.required_column(names[2]), table.required_column(names[3])};
  corners.north = number_within(table, row, columns[0], -85, 85);
  corners.west = number_within(table, row, columns[1], -180, 180);
  corners.south = number_within(table, row, columns[2], -85, corners.north);
  corners.east = number_within(table, row, columns[3], corners.west, 180);
  if (corners.south == corners.north || corners.west == corners.east) {
    throw Error({.what = "a map of the dataset has no extent", .where = table.where(row, columns[2])});
  }
  return corners;
}

// ---- UAV-VisLoc

constexpr std::array kRangeNames{"satellite_coordinates_range.csv", "satellite_ coordinates_range.csv"};

fs::path uav_visloc_map(const fs::path& folder, const std::string& name, const CsvTable& ranges, const fs::path& work) {
  const std::string file = "satellite" + name + ".tif";
  std::vector<fs::path> maps;
  if (fs::is_regular_file(folder / name / file)) {
    maps.push_back(folder / name / file);
  } else {
    for (const auto& entry : fs::directory_iterator(folder / name)) {
      const std::string part = entry.path().filename().string();
      if (part.starts_with("satellite" + name + "_") && part.ends_with(".tif")) maps.push_back(entry.path());
    }
    std::sort(maps.begin(), maps.end());
  }
  if (maps.empty()) {
    throw Error({.what = "a flight of the dataset has no map",
                 .where = (folder / name).string(),
                 .expected = file + ", or parts of it: satellite" + name + "_*.tif",
                 .found = "none",
                 .fix = "leave the flight out: name the others with --flight"});
  }
  if (std::all_of(maps.begin(), maps.end(), is_georeferenced)) return joined(maps, work / ("map" + name + ".vrt"));
  const std::size_t column = ranges.required_column("mapname");
  for (std::size_t row = 0; row < ranges.rows(); ++row) {
    if (maps.size() != 1 || ranges.cell(row, column) != file) continue;
    return georeferenced(maps.front(), kWgs84,
                         corners_in(ranges, row, {"LT_lat_map", "LT_lon_map", "RB_lat_map", "RB_lon_map"}), work);
  }
  throw Error({.what = "where a map of the dataset lies is not known",
               .where = ranges.path().string() + ", column mapname",
               .expected = "a row for " + file + ", because the file itself is not georeferenced",
               .found = maps.size() == 1 ? "none" : fmt::format("{} parts of it", maps.size())});
}

double seconds_in(const CsvTable& table, std::size_t row, std::size_t column) {
  const std::string& text = table.cell(row, column);
  std::string stamp = text;
  std::replace(stamp.begin(), stamp.end(), ' ', 'T');
  const auto time = parse_utc(stamp.ends_with('Z') ? stamp : stamp + "Z");
  if (time && stamp.find('T') != std::string::npos) return static_cast<double>(time->unix_s);
  throw Error({.what = "a picture of the dataset has no time that can be read",
               .where = table.where(row, column),
               .expected = "a date and a time such as 2018-10-23T10:50:41",
               .found = fmt::format("\"{}\"", text),
               .fix = "leave out --method flight: times are needed for nothing else"});
}

DatasetFlight uav_visloc_flight(const fs::path& folder, const std::string& name, const CameraFile& camera,
                                const CsvTable& ranges, const MapDatasetOptions& options) {
  const CsvTable table = CsvTable::read(folder / name / (name + ".csv"));
  const std::size_t file = table.required_column("filename"), date = table.required_column("date"),
                    lat = table.required_column("lat"), lon = table.required_column("lon"),
                    height = table.required_column("height");
  const auto pitch = table.column("Omega"), roll = table.column("Kappa"), heading = table.column("Phi1");
  DatasetFlight result{name, {}, {}, uav_visloc_map(folder, name, ranges, options.work)};
  result.flight.camera = camera;
  for (const std::size_t row : chosen(table.rows(), options)) {
    const fs::path picture = file_named(table, row, file, folder / name / "drone");
    check_size(picture, camera.camera);
    Telemetry telemetry;
    telemetry.frame = picture.filename().string();
    telemetry.time_s = options.in_sequence ? seconds_in(table, row, date) : static_cast<double>(row);
    if (options.in_sequence && !result.flight.frames.empty() &&
        telemetry.time_s <= result.flight.frames.back().time_s) {
      throw Error({.what = "the pictures of the dataset are not in the order of time",
                   .where = table.where(row, date),
                   .expected = "a later time than in the row before",
                   .found = table.cell(row, date),
                   .fix = "leave out --method flight, or --flight of another name"});
    }
    telemetry.agl_m = number_within(table, row, height, options.ground_m + 1, 20'000) - options.ground_m;
    telemetry.heading_rad = angle_rad(table, row, heading);
    telemetry.pitch_rad = angle_rad(table, row, pitch);
    telemetry.roll_rad = angle_rad(table, row, roll);
    add_frame(result, telemetry, picture, place_in(table, row, lat, lon));
  }
  refuse_empty(result, table.path());
  return result;
}

// ---- AnyVisLoc

// Where the local plane is put: at the equator, where tiles have the scale that they state.
constexpr LonLat kLocalOrigin{0, 0};
constexpr const char* kLocalCrs = "+proj=aeqd +lat_0=0 +lon_0=0 +datum=WGS84 +units=m +no_defs";

struct LocalRaster {
  fs::path path;
  double across_m = 0, down_m = 0;  // of a pixel
  double x_m = 0, y_m = 0;          // of the top-left corner; y to the south
};

std::array<double, 2> pair_of(const JsonReader& in, const char* name, bool required) {
  if (!required && !in.has(name)) return {0, 0};
  if (in.value(name).is_number()) {
    const double both = in.number(name);
    return {both, both};
  }
  const JsonReader list = in.array(name, {.least = 2, .most = 3});
  return {list.number(0), list.number(1)};
}

struct AnyVisLocReference {
  LocalRaster map, surface;
};

AnyVisLocReference read_reference(const fs::path& path, const std::string& which) {
  const nlohmann::json document = parse_json(read_text_file(path), path.string());
  const JsonReader in(document, {.name = path.string(), .what = "not a reference file of AnyVisLoc"});
  const JsonReader modes = in.object("modes");
  const JsonReader mode = modes.object(which);
  const auto raster = [&](const char* file, const char* size, const char* origin) {
    const std::string& name = mode.text(file);
    const fs::path relative(name);
    if (relative.is_absolute() || std::find(relative.begin(), relative.end(), "..") != relative.end()) {
      mode.refuse(file, "a file beneath the folder of the scene");
    }
    const auto [across, down] = pair_of(mode, size, true);
    if (!(across > 0) || !(down > 0)) mode.refuse(size, "metres of a pixel, above 0");
    const auto [x, y] = pair_of(mode, origin, false);
    return LocalRaster{path.parent_path() / relative, across, down, x, y};
  };
  AnyVisLocReference reference{raster("map_path", "map_resolution", "map_origin_local"),
                               raster("dsm_path", "dsm_resolution", "dsm_origin_local")};
  reference.surface.x_m += reference.map.x_m;  // relative to the map's
  reference.surface.y_m += reference.map.y_m;
  return reference;
}

std::optional<double> surface_height_m(const NumpyRaster& heights, const LocalRaster& raster, double x_m, double y_m) {
  return heights.at(static_cast<std::ptrdiff_t>(std::llround((y_m - raster.y_m) / raster.down_m)),
                    static_cast<std::ptrdiff_t>(std::llround((x_m - raster.x_m) / raster.across_m)));
}

fs::path unpacked_picture(const NumpyArchive& archive, const fs::path& npz, const fs::path& work) {
  const NumpyArray image = archive.array("image");
  if (image.header().count() == 0) {
    const fs::path relative = archive.array("image_relpath").text();
    if (relative.is_absolute() || std::find(relative.begin(), relative.end(), "..") != relative.end()) {
      throw Error({.what = "a picture of the dataset lies outside of it",
                   .where = npz.string() + ", array image_relpath",
                   .expected = "a file beneath the folder of the scene",
                   .found = relative.string()});
    }
    return fs::absolute(npz.parent_path() / relative);
  }
  const std::vector<std::size_t>& shape = image.header().shape;
  if (image.header().type != "|u1" || shape.size() != 3 || shape[2] != 3 || shape[0] > kMaxImageSide ||
      shape[1] > kMaxImageSide) {
    throw Error({.what = "a picture of the dataset is none",
                 .where = image.name(),
                 .expected = "rows × columns × 3 bytes, red, green, blue",
                 .found = fmt::format("{} of type {}", fmt::join(shape, " × "), image.header().type)});
  }
  const cv::Mat rgb(static_cast<int>(shape[0]), static_cast<int>(shape[1]), CV_8UC3,
                    const_cast<std::uint8_t*>(image.values().data()));
  cv::Mat bgr;
  cv::cvtColor(rgb, bgr, cv::COLOR_RGB2BGR);
  fs::path to = work / (npz.stem().string() + ".png");
  write_file_atomic(to, encode_image(bgr, ImageFormat::png));
  return to;
}

CameraModel camera_in(const NumpyArchive& archive, const FrameSize& size) {
  const std::vector<double> k = archive.array("K").numbers(9), lens = archive.array("dist").numbers(5);
  CameraModel camera{size.width, size.height, k[0], k[4], k[2], k[5]};
  std::copy(lens.begin(), lens.end(), camera.distortion.begin());
  if (!(camera.fx > 1) || !(camera.fy > 1)) {
    throw Error({.what = "a camera of the dataset has no focal length",
                 .where = archive.array("K").name(),
                 .expected = "pixels, above 1",
                 .found = fmt::format("{} and {}", camera.fx, camera.fy)});
  }
  return camera;
}

bool same_camera(const CameraModel& a, const CameraModel& b) {
  return a.width == b.width && a.height == b.height && a.fx == b.fx && a.fy == b.fy && a.cx == b.cx && a.cy == b.cy &&
         a.distortion == b.distortion;
}

void read_scene(const fs::path& folder, const MapDatasetOptions& options, std::vector<DatasetFlight>& flights) {
  std::optional<fs::path> json;
  std::vector<fs::path> samples;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with('L')) continue;
    if (name.ends_with("_reference.json")) json = entry.path();
    if (name.ends_with(".npz")) samples.push_back(entry.path());
  }
  std::sort(samples.begin(), samples.end());
  if (samples.empty()) {
    throw Error(
        {.what = "a scene of the dataset has no pictures", .where = folder.string(), .expected = "LNN_MMMM.npz"});
  }
  if (!json) need_file(folder / "LNN_reference.json", "AnyVisLoc");
  const AnyVisLocReference reference = read_reference(*json, options.reference);
  const fs::path work = options.work / folder.filename();
  fs::create_directories(work);
  const FrameSize size = raster_size(reference.map.path);
  const fs::path map =
      georeferenced(reference.map.path, kLocalCrs,
                    {reference.map.x_m, -reference.map.y_m, reference.map.x_m + reference.map.across_m * size.width,
                     -(reference.map.y_m + reference.map.down_m * size.height)},
                    work);
  const NumpyRaster heights(reference.surface.path);
  const LocalFrame frame(kLocalOrigin);
  const std::size_t first = flights.size();
  for (const std::size_t i : chosen(samples.size(), options)) {
    const NumpyArchive archive(samples[i]);
    const fs::path picture = unpacked_picture(archive, samples[i], work);
    const CameraModel camera = camera_in(archive, read_frame_size(picture));
    const std::vector<double> at = archive.array("xyz").numbers(3), angles = archive.array("euler_deg").numbers(3);
    Telemetry telemetry;
    telemetry.frame = samples[i].stem().string();
    telemetry.time_s = static_cast<double>(i);
    telemetry.agl_m = at[2] - surface_height_m(heights, reference.surface, at[0], at[1]).value_or(0);
    telemetry.roll_rad = radians(angles[0]);
    telemetry.pitch_rad = radians(angles[1]);
    telemetry.heading_rad = wrap_pi(radians(angles[2]));
    if (!(*telemetry.agl_m > 1)) {
      throw Error({.what = "a picture of the dataset is taken from below the surface",
                   .where = archive.array("xyz").name(),
                   .expected = "above the height of the surface model there",
                   .found = fmt::format("{:.1f} m above it", *telemetry.agl_m)});
    }
    auto flight = std::find_if(flights.begin() + static_cast<std::ptrdiff_t>(first), flights.end(),
                               [&](const DatasetFlight& one) { return same_camera(one.flight.camera.camera, camera); });
    if (flight == flights.end()) {
      flights.push_back({folder.filename().string(), {}, {}, map});
      flight = flights.end() - 1;
      flight->flight.camera.camera = camera;
    }
    add_frame(*flight, telemetry, picture, frame.lonlat_from_plane({at[0], -at[1]}));
  }
}

}  // namespace

std::vector<DatasetFlight> read_uav_visloc(const fs::path& folder, const MapDatasetOptions& options) {
  register_gdal_drivers();
  fs::path file = folder / kRangeNames[0];
  if (!fs::is_regular_file(file) && fs::is_regular_file(folder / kRangeNames[1])) file = folder / kRangeNames[1];
  const CsvTable ranges = CsvTable::read(need_file(file, "UAV-VisLoc"));
  const CameraFile camera = stated_camera(options, "UAV-VisLoc");
  std::vector<std::string> there;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (entry.is_directory() && fs::is_regular_file(entry.path() / (name + ".csv"))) there.push_back(name);
  }
  std::vector<DatasetFlight> flights;
  for (const std::string& name : wanted_flights(there, options, folder)) {
    flights.push_back(uav_visloc_flight(folder, name, camera, ranges, options));
  }
  return flights;
}

std::vector<DatasetFlight> read_wildnav(const fs::path& given, const MapDatasetOptions& options) {
  register_gdal_drivers();
  refuse_sequence(options, "WildNav");
  const fs::path folder = fs::is_directory(given / "assets") ? given / "assets" : given;
  const CsvTable maps = CsvTable::read(need_file(folder / "map" / "map.csv", "WildNav"));
  const CsvTable photos = CsvTable::read(need_file(folder / "query" / "photo_metadata.csv", "WildNav"));
  const CameraFile camera = stated_camera(options, "WildNav");
  std::vector<fs::path> parts;
  for (std::size_t row = 0; row < maps.rows(); ++row) {
    const fs::path picture = file_named(maps, row, maps.required_column("Filename"), folder / "map");
    parts.push_back(
        georeferenced(picture, kWgs84,
                      corners_in(maps, row, {"Top_left_lat", "Top_left_lon", "Bottom_right_lat", "Bottom_right_long"}),
                      options.work));
  }
  if (parts.empty()) throw Error({.what = "the dataset has no map", .where = maps.path().string()});
  DatasetFlight result{"query", {}, {}, joined(parts, options.work / "map.vrt")};
  result.flight.camera = camera;
  const std::size_t file = photos.required_column("Filename"), lat = photos.required_column("Latitude"),
                    lon = photos.required_column("Longitude"), height = photos.required_column("Altitude"),
                    roll = photos.required_column("Gimball_Roll"), heading = photos.required_column("Gimball_Yaw"),
                    pitch = photos.required_column("Gimball_Pitch");
  for (const std::size_t row : chosen(photos.rows(), options)) {
    const fs::path picture = file_named(photos, row, file, folder / "query");
    check_size(picture, camera.camera);
    Telemetry telemetry;
    telemetry.frame = picture.filename().string();
    telemetry.time_s = static_cast<double>(row);
    telemetry.agl_m = number_within(photos, row, height, 1, 20'000);
    telemetry.heading_rad = angle_rad(photos, row, heading);
    telemetry.roll_rad = angle_rad(photos, row, roll);
    if (const auto down = angle_rad(photos, row, pitch)) telemetry.pitch_rad = *down + kPi / 2;
    add_frame(result, telemetry, picture, place_in(photos, row, lat, lon));
  }
  refuse_empty(result, photos.path());
  return {result};
}

std::vector<DatasetFlight> read_anyvisloc(const fs::path& folder, const MapDatasetOptions& options) {
  register_gdal_drivers();
  refuse_sequence(options, "AnyVisLoc");
  if (!fs::is_directory(folder)) need_file(folder / "Scene_NN" / "LNN_reference.json", "AnyVisLoc");
  std::vector<std::string> there;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.is_directory() && entry.path().filename().string().starts_with("Scene_")) {
      there.push_back(entry.path().filename().string());
    }
  }
  std::vector<DatasetFlight> flights;
  for (const std::string& name : wanted_flights(there, options, folder)) read_scene(folder / name, options, flights);
  return flights;
}

}  // namespace nadir
