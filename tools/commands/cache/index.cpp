// nadir cache index: adds a place index to a package, or asks the one that is there how good it is.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <thread>
#include <vector>

#include "base/error.hpp"
#include "base/progress.hpp"
#include "base/random.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/cache/shard_options.hpp"
#include "commands/commands.hpp"
#include "datasets/place_recall.hpp"
#include "geodesy/angles.hpp"
#include "imagery/tile_source.hpp"
#include "package/manifest.hpp"
#include "package/mission.hpp"
#include "package/package_writer.hpp"
#include "package/tile_container.hpp"
#include "package_build/package_builder.hpp"
#include "replay/flight_folder.hpp"
#include "replay/score.hpp"
#include "token_keys/token_key.hpp"
#include "vision/place_index.hpp"
#include "vision/place_index_builder.hpp"

namespace nadir {
namespace {

constexpr double kLayerRatio = 1.5;        // between neighbouring sizes of chunks
constexpr double kNominalFootprint = 1.0;  // of the height, when no camera is named: a lens of some 55 degrees
constexpr std::string_view kSimulated = "simulated";

const Artifact& imagery_of(const Manifest& manifest) {
  const Artifact* imagery = manifest.artifact(kRoleImagery);
  if (imagery != nullptr && imagery->tiles) return *imagery;
  throw Error({.what = "the package has no imagery to index", .where = std::string(kManifestFile)});
}

// The map of a package, to be described.
IndexedMap map_of(const TileSource& tiles, std::vector<TileKey> finest, const Manifest& manifest,
                  const Mission& mission) {
  return {&tiles, std::move(finest), imagery_of(manifest).tiles->merkle_root, mission.takeoff};
}

// Addresses of the finest zoom, in order.
std::vector<TileKey> finest_keys(const std::filesystem::path& imagery, int zoom) {
  std::vector<TileKey> keys;
  const std::unique_ptr<TileContainer> container = open_tile_container(imagery);
  const std::unique_ptr<TileCursor> cursor = container->tiles(false);
  while (cursor->next()) {
    if (const auto key = cursor->key(); key && key->z == zoom) keys.push_back(*key);
  }
  std::sort(keys.begin(), keys.end());
  if (keys.empty()) throw Error({.what = "the package has no tiles of its finest zoom", .where = imagery});
  return keys;
}

// Sizes from the smallest to the largest, none more than kLayerRatio from its neighbour.
std::vector<double> layers_between(double least_m, double most_m) {
  const int steps = static_cast<int>(std::ceil(std::log(most_m / least_m) / std::log(kLayerRatio) - 1e-9));
  std::vector<double> result{least_m};
  for (int i = 1; i <= steps; ++i)
    result.push_back(least_m * std::pow(most_m / least_m, static_cast<double>(i) / steps));
  return result;
}

// As another day, sensor and light might show it.
cv::Mat other_day(const cv::Mat& grey, Random& random) {
  cv::Mat changed, noise(grey.size(), CV_32FC1);
  grey.convertTo(changed, CV_32F);
  const double sigma_px = random.uniform(0.3, 1.0);
  cv::GaussianBlur(changed, changed, cv::Size(), sigma_px, sigma_px, cv::BORDER_REFLECT_101);
  const double gain = random.uniform(0.6, 1.3), offset = random.uniform(-30, 30), noise_sigma = random.uniform(3, 10);
  for (int row = 0; row < noise.rows; ++row) {
    for (int column = 0; column < noise.cols; ++column) {
      noise.at<float>(row, column) = static_cast<float>(random.normal(0, noise_sigma));
    }
  }
  changed = changed * gain + noise;
  cv::Mat result;
  changed.convertTo(result, CV_8U, 1, offset);
  return result;
}

// A picture of w x h pixels, turned, in the middle of a mask.
cv::Mat turned_rectangle(cv::Size size, cv::Size2d picture, double heading_rad) {
  cv::Mat mask(size, CV_8UC1, cv::Scalar(0));
  const double cosine = std::cos(heading_rad), sine = std::sin(heading_rad);
  for (int row = 0; row < size.height; ++row) {
    for (int column = 0; column < size.width; ++column) {
      const double x = column + 0.5 - size.width / 2.0, y = row + 0.5 - size.height / 2.0;
      const bool seen =
          std::abs(cosine * x + sine * y) <= picture.width / 2 && std::abs(cosine * y - sine * x) <= picture.height / 2;
      mask.at<std::uint8_t>(row, column) = seen ? 255 : 0;
    }
  }
  return mask;
}

// A folder with frames/, telemetry.csv, camera.yaml and truth.csv. camera: instead of the folder's.
PlaceEvaluation evaluate_flight(const PlaceIndex& index, const Mission& mission, const std::filesystem::path& folder,
                                const std::optional<std::filesystem::path>& camera, const PlaceRecallOptions& options,
                                Progress& progress) {
  const Flight flight =
      read_flight({folder / "frames", folder / "telemetry.csv", camera.value_or(folder / "camera.yaml")});
  const Truth truth = read_truth(folder / "truth.csv", flight.frames);
  return evaluate_frames(index, std::array{FlightWithTruth{flight, truth}}, mission.route.agl_m, options, progress);
}

// `count` views of the map as another day might show it: turned, up to 5 % larger or smaller, brighter or darker,
// less contrast, blurred, noisy; of the index's first layer, 4:3.
PlaceEvaluation evaluate_views(const PlaceIndex& index, const TileSource& tiles, std::size_t count,
                               const PlaceRecallOptions& options, Progress& progress) {
  const PlaceTable& table = index.table();
  PlaceEvaluation evaluation;
  PlaceScorer known(index, evaluation.known), unknown(index, evaluation.unknown);
  Random random = Random(options.seed).fork("place views");
  const LocalFrame frame(table.origin());
  const PlaceLayer& layer = table.layers.front();
  ChunkReader reader(tiles, table.origin());
  progress.begin("asking", count, "views");
  for (std::size_t i = 0; i < count && layer.count > 0; ++i) {
    progress.advance();
    // Anywhere within the middle half of a chunk: where neighbours overlap by half, that is anywhere at all.
    const auto chunk = layer.first + static_cast<std::size_t>(random.uniform() * static_cast<double>(layer.count));
    const PlanePoint middle = frame.plane_from_lonlat(table.chunks[chunk].centre());
    const double north_m = random.uniform(-0.25, 0.25) * layer.side_m();
    const double east_m = random.uniform(-0.25, 0.25) * layer.side_m();
    const LonLat place = frame.lonlat_from_plane({middle.east_m + east_m, middle.north_m + north_m});
    const PlaceChunk view{std::llround(place.lon_deg * 1e7), std::llround(place.lat_deg * 1e7), {}};
    const MapWindow window = reader.around(layer, view, 2.2);
    const cv::Mat grey = other_day(window.image, random);
    const double scale = random.uniform(0.95, 1.05);
    const double heading_rad = random.uniform(0, 2 * std::numbers::pi);
    const double side_px = static_cast<double>(layer.side_px);
    for (PlaceRecall* recall : {&evaluation.known, &evaluation.unknown}) {
      const bool is_known = recall == &evaluation.known;
      const double error_rad = is_known ? random.uniform(-options.heading_range_rad, options.heading_range_rad)
                                        : random.uniform(0, 2 * std::numbers::pi);
      // The picture lies in the assumed north-up frame turned clockwise by the error of its heading.
      PatchPlacement placement;
      placement.centre = {grey.cols / 2.0, grey.rows / 2.0};
      placement.turn_rad = -error_rad;
      placement.pixels_per_px = scale;
      placement.side_px = static_cast<int>(std::lround(1.5 * side_px));
      PlacePatch picture = PatchCutter(grey, window.mask, 1).cut(placement);
      const double root = std::sqrt(4.0 / 3.0);
      picture.mask &= turned_rectangle(picture.mask.size(), {side_px * root, side_px / root}, heading_rad);
      (is_known ? known : unknown)
          .ask({picture.grey, picture.mask, layer.gsd_m(),
                is_known ? std::optional<double>(options.heading_range_rad) : std::nullopt},
               place);
    }
  }
  progress.end();
  known.finish();
  unknown.finish();
  return evaluation;
}

class CacheIndexCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "index"; }
  std::string_view summary() const override { return "add a place index to a package, for cold starts"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  int make_shard(Context& context) const;
  int make(Context& context, const Manifest& manifest, const Mission& mission) const;
  int evaluate(Context& context, const Manifest& manifest, const Mission& mission) const;
  std::vector<double> footprints_m(const Mission& mission) const;
  PlaceIndexOptions index_options(const Mission& mission) const;

  std::filesystem::path package_;
  std::optional<std::filesystem::path> key_;
  std::optional<std::filesystem::path> camera_;
  std::vector<double> agl_m_;
  std::vector<double> footprints_m_;
  std::optional<double> gsd_m_;
  int overlap_percent_ = 75;
  std::optional<int> threads_;
  ShardOptions shards_{"nadir cache index", "index"};
  std::optional<std::string> evaluate_;
  std::uint64_t views_ = 200;
  std::uint64_t seed_ = 1;
  double heading_range_deg_ = 15;
};

std::string_view CacheIndexCommand::details() const {
  return R"(Cuts the map into squares of an image's size, overlapping by three quarters, and describes each by
the directions of its edges. An aircraft without a position asks the index for the places that look
like its view. The size follows from the camera and the height above ground: the mission's planned
height, or --agl-m, given several times where heights vary; or set it with --footprint-m. Water and
other featureless ground is left out and counted.

The package's manifest lists the two files of the index, so a signed package must be signed again:
give --key. All files are hashed first; a package that does not match its manifest is rejected
(exit code 1). The package changes in one step or not at all. Index before the package is
distributed: two packages of one sequence, with and without index, should not both be in use.

Several machines may share the work: each runs it with --shard I/N --shards FOLDER and the same
options, which reads the package and writes the folder index-I-of-N; then one runs it with --shards
FOLDER, and gets the index that it would have made alone, byte for byte.

--evaluate changes nothing: it reports how often the correct place is among the first 1, 5 and 20,
for frames with ground truth (a folder with frames/, telemetry.csv, camera.yaml, truth.csv) or for
views synthesized from the map with another day's appearance (--evaluate simulated). A hit: the
true position lies inside the square.)";
}

std::string_view CacheIndexCommand::examples() const {
  return R"(nadir cache index package --camera camera.yaml --key planner.key.pem
nadir cache index package --camera camera.yaml --agl-m 100 --agl-m 250 --key planner.key.pem
nadir cache index package --camera camera.yaml --shards work --shard 3/8
nadir cache index package --camera camera.yaml --shards work --key planner.key.pem
nadir cache index package --evaluate simulated
nadir cache index package --evaluate flight --json)";
}

void CacheIndexCommand::setup(Options& options) {
  options.positional("PACKAGE", package_, "package folder").required();
  options.value("--key", key_, "KEY.pem",
                "private key (file or pkcs11: URI) of a package signer; required if the package is signed");
  options.value("--camera", camera_, "FILE.yaml", "camera whose images will be looked up");
  options.values("--agl-m", agl_m_, "METRES", "height above ground; default: the mission's").between(1, 20000);
  options
      .values("--footprint-m", footprints_m_, "METRES",
              "side of the squares, instead of deriving it from camera and height")
      .between(10, 50000);
  options.value("--gsd-m", gsd_m_, "METRES", "resolution of a square; default: 96 pixels per side")
      .between(0.01, 500)
      .formerly("--gsd");
  options.value("--overlap-percent", overlap_percent_, "PERCENT", "overlap of neighbouring squares")
      .between(0, 90)
      .formerly("--overlap");
  options.value("--threads", threads_, "N", "threads; default: one per processor. The result does not depend on it")
      .between(1, 256);
  shards_.setup(options);
  options.value("--evaluate", evaluate_, "DIR|simulated", "evaluate the existing index, without changing it");
  options.value("--views", views_, "N", "with --evaluate simulated: number of views").between(1, 100000);
  options.value("--seed", seed_, "N", "with --evaluate: random seed for views and heading errors");
  options.value("--heading-range-deg", heading_range_deg_, "DEG", "with --evaluate: maximum error of a known heading")
      .between(0, 180);
}

std::vector<double> CacheIndexCommand::footprints_m(const Mission& mission) const {
  if (!footprints_m_.empty()) {
    std::vector<double> sorted = footprints_m_;
    std::sort(sorted.begin(), sorted.end());
    sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
    return sorted;
  }
  std::vector<double> heights = agl_m_;
  if (heights.empty()) heights.push_back(mission.route.agl_m);
  double per_metre = kNominalFootprint;
  if (camera_) {
    const CameraModel camera = read_camera_file(*camera_).camera;
    const double gsd_m = gsd_at(camera, 1);
    per_metre = place_footprint_m(gsd_m * camera.width, gsd_m * camera.height);
  }
  const auto [least, most] = std::minmax_element(heights.begin(), heights.end());
  return layers_between(*least * per_metre, *most * per_metre);
}

PlaceIndexOptions CacheIndexCommand::index_options(const Mission& mission) const {
  return {.footprints_m = footprints_m(mission),
          .gsd_m = gsd_m_,
          .overlap_percent = overlap_percent_,
          .threads = threads_.value_or(static_cast<int>(std::max(1U, std::thread::hardware_concurrency())))};
}

// Reads the tiles that it describes, and hashes those; whoever takes the shards hashes the whole package.
int CacheIndexCommand::make_shard(Context& context) const {
  const Manifest manifest = load_package_manifest(package_);
  const Mission mission = read_signed_mission(package_, manifest);
  const CheckedTileSet set = open_checked_tiles(package_, manifest, context.progress);
  if (!set.tiles) return report_findings(context.out, context.json, set.findings);
  std::vector<TileKey> finest;
  for (const Sidecar& tile : set.tiles->sidecars()) {
    if (tile.key.z == set.tiles->zooms().max) finest.push_back(tile.key);
  }
  const IndexedMap map = map_of(*set.tiles, std::move(finest), manifest, mission);
  const PlaceIndexOptions options = index_options(mission);
  return shards_.make(PlaceIndexBuilder(map, options), manifest, *set.tiles, options.threads, context);
}

int CacheIndexCommand::run(Context& context) {
  shards_.check();
  if (shards_.make_one()) return make_shard(context);
  const Manifest manifest = load_package_manifest(package_);
  if (!evaluate_) require_key_when_signed(package_, key_.has_value());
  const Findings findings = check_before_signing(package_, context.progress);
  if (findings.has_errors()) return report_findings(context.out, context.json, findings);
  const Mission mission = read_mission(package_ / kMissionFile);
  return evaluate_ ? evaluate(context, manifest, mission) : make(context, manifest, mission);
}

int CacheIndexCommand::make(Context& context, const Manifest& manifest, const Mission& mission) const {
  std::optional<PrivateKey> key;
  if (key_) key = read_signing_key(*key_);
  const Artifact& imagery = imagery_of(manifest);
  const std::unique_ptr<TileSource> tiles = open_tile_source(package_ / imagery.path);
  const IndexedMap map =
      map_of(*tiles, finest_keys(package_ / imagery.path, imagery.tiles->zoom.max), manifest, mission);
  const PlaceIndexOptions options = index_options(mission);
  PlaceIndexBuilder builder(map, options);
  shards_.finish(builder, package_, manifest, options.threads, context.progress);
  const PlaceIndex index = builder.finish(context.progress);
  const Amendment amendment{{kRolePlaceIndex, kRolePlaceTable},
                            [&](const std::filesystem::path& folder) { return write_place_index(folder, index); }};
  const AmendedPackage indexed =
      amend_package(package_, manifest, mission, amendment, key ? &*key : nullptr, context.progress);
  if (indexed.findings.has_errors()) {
    if (!context.quiet) context.err << "rejected: the package is unchanged\n";
    return report_findings(context.out, context.json, indexed.findings);
  }
  nlohmann::json more{{"package", package_.string()},       {"chunks", index.table().chunks.size()},
                      {"index_bytes", indexed.added_bytes}, {"variance_kept", index.table().projection.kept},
                      {"signed", indexed.is_signed},        {"layers", nlohmann::json::array()}};
  Figures figures{{"package", package_.string()}};
  for (const PlaceLayer& layer : index.table().layers) {
    more["layers"].push_back({{"side_m", layer.side_m()},
                              {"gsd_m", layer.gsd_m()},
                              {"chunks", layer.count},
                              {"textureless", layer.textureless},
                              {"invalid", layer.invalid}});
    figures.emplace_back(fmt::format("places of {:.0f} m", layer.side_m()),
                         fmt::format("{} at {:.2f} m per pixel; left out: {} featureless, {} with too little map",
                                     layer.count, layer.gsd_m(), layer.textureless, layer.invalid));
  }
  figures.emplace_back(
      "index", fmt::format("{:.2f} MB, {:.1f} % of the variance kept", static_cast<double>(indexed.added_bytes) / 1e6,
                           100 * index.table().projection.kept));
  figures.emplace_back("signed by", key ? key->public_key().id() : "unsigned");
  if (context.json) return report_findings(context.out, true, indexed.findings, more);
  print_figures(context.out, figures);
  if (!camera_ && footprints_m_.empty() && !context.quiet) {
    context.err << "No --camera was given: assuming an image footprint as wide as the height above ground.\n";
  }
  return kAccepted;
}

int CacheIndexCommand::evaluate(Context& context, const Manifest& manifest, const Mission& mission) const {
  const std::optional<PlaceIndex> index = PlaceIndex::open(Directory(package_), manifest);
  if (!index) {
    throw UsageError({.what = "this package has no place index",
                      .where = package_,
                      .expected = std::string(kPlaceIndexFile),
                      .found = "none",
                      .fix = "create one first: nadir cache index PACKAGE"});
  }
  const PlaceRecallOptions options{radians(heading_range_deg_), seed_};
  const std::unique_ptr<TileSource> tiles = open_tile_source(package_ / imagery_of(manifest).path);
  const PlaceEvaluation evaluation =
      *evaluate_ == kSimulated
          ? evaluate_views(*index, *tiles, static_cast<std::size_t>(views_), options, context.progress)
          : evaluate_flight(*index, mission, *evaluate_, camera_, options, context.progress);
  if (context.json) {
    print_json(context.out, {{"package", package_.string()},
                             {"against", *evaluate_},
                             {"chunks", index->table().chunks.size()},
                             {"heading_range_deg", heading_range_deg_},
                             {"left_out", evaluation.left_out},
                             {"heading_known", json_from(evaluation.known)},
                             {"heading_unknown", json_from(evaluation.unknown)}});
    return kAccepted;
  }
  print_figures(context.out,
                {{"queries", fmt::format("{}, {} left out", evaluation.known.queries, evaluation.left_out)},
                 {"chunks", std::to_string(index->table().chunks.size())},
                 {fmt::format("heading known to ±{:g}°", heading_range_deg_), text_from(evaluation.known)},
                 {"heading unknown", text_from(evaluation.unknown)}});
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_cache_index() { return std::make_unique<CacheIndexCommand>(); }

}  // namespace nadir
