#include "replay.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <ostream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "estimation/terrain_surface.hpp"
#include "framework/options.hpp"
#include "framework/output.hpp"
#include "replay/backends.hpp"
#include "replay/flight_map.hpp"
#include "replay/replay_flight.hpp"
#include "replay/report.hpp"
#include "replay/summary.hpp"
#include "replay/track_geojson.hpp"
#include "vision/place_index.hpp"

namespace nadir {
namespace {

std::vector<Estimate> estimates_of(const std::vector<FrameReport>& reports) {
  std::vector<Estimate> estimates;
  for (const FrameReport& report : reports) estimates.push_back(report.estimate);
  return estimates;
}

std::optional<PlaneBox> box_of(const std::vector<Estimate>& estimates, const Truth& truth, const LocalFrame& frame) {
  std::optional<PlaneBox> box;
  const auto include = [&](const std::optional<LonLat>& place) {
    if (!place) return;
    const Enu enu = frame.enu_from_lonlat(*place);
    if (!box) box = PlaneBox{enu.east_m, enu.north_m, enu.east_m, enu.north_m};
    box->west_m = std::min(box->west_m, enu.east_m);
    box->east_m = std::max(box->east_m, enu.east_m);
    box->south_m = std::min(box->south_m, enu.north_m);
    box->north_m = std::max(box->north_m, enu.north_m);
  };
  for (const Estimate& estimate : estimates) include(estimate.position);
  for (const auto& place : truth) include(place);
  return box;
}

std::string name_of_flight(const std::filesystem::path& frames) {
  const auto folder = std::filesystem::weakly_canonical(frames);
  return folder.filename() == "frames" ? folder.parent_path().filename().string() : folder.filename().string();
}

void write_refined(const std::filesystem::path& path, const std::vector<Estimate>& refined) {
  EstimatesCsv csv(path);
  for (const Estimate& estimate : refined) csv.write(estimate);
}

}  // namespace

std::string_view ReplayCommand::details() const {
  return "Reads pictures, telemetry and camera of a recorded flight and localizes every frame as the aircraft would: "
         "against a signed package when one is given, else by odometry from --start alone. The truth is for scoring; "
         "the localizer never sees it.\n\n"
         "OUT receives estimates.csv, refined.csv, summary.json, track.geojson and report.html. It appears when all is "
         "done; until then the rows can be followed in the hidden folder .OUT.staging beside it.\n\n"
         "Exit codes: 0 replayed, 1 the package was refused, 2 an input is missing or wrong.";
}

std::string_view ReplayCommand::examples() const {
  return "nadir replay --package valley --trust root.json --frames flight/frames --telemetry flight/telemetry.csv "
         "--camera camera.yaml --start 8.5,47.4 --out result\n"
         "nadir replay --frames frames --telemetry telemetry.csv --camera camera.yaml --start=-83.30572,41.03467 --out "
         "odometry";
}

void ReplayCommand::setup(Options& options) {
  options.value("--frames", paths_.frames, "DIR", "folder with the pictures").required();
  options.value("--telemetry", paths_.telemetry, "FILE.csv", "one row per picture, in the order of time").required();
  options.value("--camera", paths_.camera, "FILE.yaml", "camera model and uncertainty of the telemetry").required();
  options.value("--out", out_, "OUT", "folder that is made").required();
  options.value("--package", package_, "PACKAGE", "the mission package to localize against").needs("--trust");
  options.value("--trust", trust_, "FILE.json", "root of trust that the package must be signed under")
      .needs("--package");
  options.value("--airframe", airframe_, "ID", "the package must be made for this airframe").needs("--package");
  options.value("--at", at_, "TIME", "judge the package as if it were then; the present time by default");
  options.value("--start", start_, "LON,LAT",
                "where the first frame was taken; without it all of the mission's area is searched");
  options
      .value("--odometry", odometry_, "NAME",
             "how motion is seen: features (SIFT), or flow (whole pictures and patches)")
      .one_of({"features", "flow"});
  options
      .value("--matcher", matcher_, "NAME",
             "how frames are matched with the map: channels (oriented gradients), or sift")
      .one_of({"channels", "sift"})
      .needs("--package");
  options.value("--truth", truth_, "FILE.csv", "real positions, for scoring only");
}

int ReplayCommand::run(Context& context) {
  const Flight flight = read_flight(paths_);
  const Truth truth = truth_ ? read_truth(*truth_, flight.frames) : Truth(flight.frames.size());
  if (flight.pictures_without_row != 0 && !context.quiet) {
    context.err << fmt::format("note: {} pictures have no row in {} and are left out\n", flight.pictures_without_row,
                               paths_.telemetry.string());
  }
  if (!start_ && !package_) {
    throw UsageError({.what = "nadir replay without --package needs --start LON,LAT",
                      .expected = "the position of the first frame: odometry alone cannot find it",
                      .fix = "give --start, or a map with --package and --trust"});
  }

  std::unique_ptr<OpenPackage> package;
  std::optional<TerrainSurface> surface;
  std::optional<PlaceIndex> places;
  ReplaySetup setup{.frame = LocalFrame(start_.value_or(LonLat{})),
                    .tiles = nullptr,
                    .map_sigma_m = std::nullopt,
                    .start = start_,
                    .area = std::nullopt,
                    .surface = nullptr,
                    .places = nullptr,
                    .odometry = odometry_named(odometry_),
                    .matcher = matcher_named(matcher_)};
  if (package_) {
    Opening opening =
        open_flight_map({*package_, *trust_, airframe_}, judging_time(at_, context.clock), context.progress);
    if (!opening.package) return report_findings(context.out, context.json, opening.findings);
    package = std::move(opening.package);
    setup.frame = mission_frame(package->mission());
    setup.area = required_region(package->mission(), setup.frame).bounds();
    setup.tiles = &package->imagery();
    places = PlaceIndex::open(*package_, package->manifest());
    if (places) setup.places = &*places;
    setup.map_sigma_m = map_sigma_m(package->imagery());
    if (package->terrain() != nullptr) {
      setup.surface = &surface.emplace(*package->terrain(), setup.frame, package->mission().terrain.height_m);
    }
  }
  const LocalFrame& frame = setup.frame;

  StagingDirectory staging(out_);
  EstimatesCsv csv(staging.path() / "estimates.csv");
  ReplayedFlight flown = replay_flight(flight, setup, truth, csv, context.progress);
  write_refined(staging.path() / "refined.csv", flown.refined);

  const std::vector<Estimate> estimates = estimates_of(flown.frames);
  const Summary summary{score(estimates, truth, frame), score(flown.refined, truth, frame), peak_memory_mb()};
  const nlohmann::json document = json_from(summary);
  write_file_atomic(staging.path() / "summary.json", document.dump(2) + "\n");
  write_file_atomic(staging.path() / "track.geojson", track_geojson(estimates, flown.refined, truth));

  ReportInput report{
      .title = "Replay of " + name_of_flight(paths_.frames),
      .subtitle = fmt::format("{} frames · {}", flight.frames.size(),
                              package ? "map package " + package->manifest().mission_id : "odometry alone, no map"),
      .frame = frame,
      .frames = std::move(flown.frames),
      .refined = std::move(flown.refined),
      .truth = truth,
      .score = summary.streamed,
      .figures = figures_from(summary),
      .worst = std::move(flown.worst),
      .map = std::nullopt};
  const auto box = box_of(estimates, truth, frame);
  if (package && box) report.map = report_map(package->imagery(), frame, *box);
  write_file_atomic(staging.path() / "report.html", report_html(report));
  staging.commit();

  if (context.json) {
    print_json(context.out, document);
  } else {
    print_figures(context.out, report.figures);
    context.out << "report  " << (out_ / "report.html").string() << '\n';
  }
  // Tiles that failed their digest in flight were treated as missing; whoever flies this package must know.
  if (package && !package->imagery().findings().empty()) {
    print_findings(context.err, package->imagery().findings());
    return kRefused;
  }
  return kAccepted;
}

}  // namespace nadir
