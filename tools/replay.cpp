#include "replay.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <ostream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/printable.hpp"
#include "base/sha256.hpp"
#include "estimation/terrain_surface.hpp"
#include "framework/options.hpp"
#include "framework/output.hpp"
#include "nadir_version.hpp"
#include "recorder/record_codec.hpp"
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

// The same flight has the same id.
std::string id_of(const Flight& flight) {
  Sha256Stream digest;
  for (const Telemetry& told : flight.frames) digest.update(encode(Record(InputRecord{0, told, {}, 0})));
  return digest.finish().hex().substr(0, 12);
}

void print_reproduction(Context& context, const Reproduction& result) {
  context.out << fmt::format("reproduced  {} of {} recorded estimates bit for bit\n", result.same, result.compared);
  if (!result.first_other) return;
  context.err << printable(fmt::format("the first other estimate: frame {}\n", *result.first_other));
}

nlohmann::json json_from(const Reproduction& result) {
  nlohmann::json document{{"compared", result.compared}, {"same", result.same}};
  if (result.first_other) document["first_other"] = *result.first_other;
  return document;
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
         "With --record the replay is recorded as the aircraft records a flight. With --recorder a recorded flight is "
         "flown "
         "again with all that it was flown with, and every estimate compared.\n\n"
         "Exit codes: 0 replayed, 1 the package was refused or an estimate is not the recorded one, 2 an input is "
         "missing "
         "or wrong.";
}

std::string_view ReplayCommand::examples() const {
  return "nadir replay --package valley --trust root.json --frames flight/frames --telemetry flight/telemetry.csv "
         "--camera camera.yaml --start 8.5,47.4 --out result\n"
         "nadir replay --recorder recording --package valley --trust root.json --out again\n"
         "nadir replay --frames frames --telemetry telemetry.csv --camera camera.yaml --start=-83.30572,41.03467 --out "
         "odometry";
}

void ReplayCommand::setup(Options& options) {
  options.value("--frames", frames_, "DIR", "folder with the pictures");
  options.value("--telemetry", telemetry_, "FILE.csv", "one row per picture, in the order of time");
  options.value("--camera", camera_, "FILE.yaml", "camera model and uncertainty of the telemetry");
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
  options.value("--record", record_, "DIR", "folder that is made: the replay as the flight recorder records it");
  options.flag("--keep-frames", keep_frames_, "the recording holds the pictures themselves").needs("--record");
  options.value("--recorder", recorder_, "DIR",
                "fly what the flight recorder holds instead of --telemetry and --camera, and compare bit for bit");
  options.value("--session", session_, "ID", "of the recording, when it holds several").needs("--recorder");
}

void ReplayCommand::check_options() const {
  if (recorder_) {
    if (telemetry_ || camera_ || start_) {
      throw UsageError({.what = "nadir replay --recorder takes telemetry, camera and start from the recording",
                        .fix = "leave out --telemetry, --camera and --start"});
    }
    return;
  }
  if (!frames_ || !telemetry_ || !camera_) {
    throw UsageError({.what = "nadir replay needs a flight",
                      .expected = "--frames, --telemetry and --camera, or --recorder",
                      .fix = "nadir replay --help shows examples"});
  }
  if (!start_ && !package_) {
    throw UsageError({.what = "nadir replay without --package needs --start LON,LAT",
                      .expected = "the position of the first frame: odometry alone cannot find it",
                      .fix = "give --start, or a map with --package and --trust"});
  }
}

Flight ReplayCommand::flight_to_fly(Context& context, const std::filesystem::path& unpacked,
                                    std::optional<RecordedFlight>& recorded) {
  if (recorder_) {
    recorded = read_recorded_flight({*recorder_, session_, frames_, unpacked});
    if (recorded->unusable_inputs != 0 && !context.quiet) {
      context.err << fmt::format("note: {} inputs after a missing one are left out\n", recorded->unusable_inputs);
    }
    const bool mapped = recorded->session.package.has_value();
    const std::optional<Sha256> package =
        package_ ? std::optional(sha256_file(*package_ / "manifest.json")) : std::nullopt;
    if (package != recorded->session.package) {
      throw UsageError({.what = "the flight was flown with another map",
                        .where = package_ ? package_->string() : std::string(),
                        .expected = mapped ? fmt::format("--package with a manifest of SHA-256 {} (mission {})",
                                                         recorded->session.package->hex(), recorded->session.mission)
                                           : "no --package: there was none",
                        .found = package ? package->hex() : "no package"});
    }
    return recorded->flight;
  }
  const FlightPaths paths{*frames_, *telemetry_, *camera_};
  Flight flight = read_flight(paths);
  if (flight.pictures_without_row != 0 && !context.quiet) {
    context.err << fmt::format("note: {} pictures have no row in {} and are left out\n", flight.pictures_without_row,
                               paths.telemetry.string());
  }
  return flight;
}

int ReplayCommand::run(Context& context) {
  check_options();
  StagingDirectory staging(out_);
  const std::filesystem::path unpacked = staging.path() / "unpacked";
  std::filesystem::create_directory(unpacked);
  std::optional<RecordedFlight> recorded;
  const Flight flight = flight_to_fly(context, unpacked, recorded);
  if (recorded) {
    start_ = recorded->session.start;
    for (const auto& [name, value] : recorded->session.settings) {
      if (name == "odometry") odometry_ = value;
      if (name == "matcher") matcher_ = value;
    }
  }
  const Truth truth = truth_ ? read_truth(*truth_, flight.frames) : Truth(flight.frames.size());

  std::unique_ptr<OpenPackage> package;
  std::optional<TerrainSurface> surface;
  std::optional<PlaceIndex> places;
  ReplaySetup setup{.frame = LocalFrame(recorded ? recorded->session.origin : start_.value_or(LonLat{})),
                    .tiles = nullptr,
                    .map_sigma_m = std::nullopt,
                    .start = start_,
                    .area = std::nullopt,
                    .surface = nullptr,
                    .places = nullptr,
                    .odometry = odometry_named(odometry_),
                    .matcher = matcher_named(matcher_),
                    .recording = nullptr,
                    .recorded = recorded ? &*recorded : nullptr};
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

  std::optional<StagingDirectory> record_folder;
  std::optional<ReplayRecording> recording;
  if (record_) {
    record_folder.emplace(*record_);
    SessionRecord session{.id = id_of(flight),
                          .program = "nadir replay",
                          .version = kVersion,
                          .airframe = airframe_.value_or(""),
                          .package = package ? std::optional(sha256_file(*package_ / "manifest.json")) : std::nullopt,
                          .mission = package ? package->manifest().mission_id : "",
                          .camera = flight.camera,
                          .origin = frame.origin(),
                          .start = start_,
                          .picture_shrink = picture_shrink(flight, setup),
                          .localizer = localizer_config(setup),
                          .terrain = setup.surface != nullptr,
                          .places = setup.places != nullptr,
                          .settings = {{"odometry", odometry_}, {"matcher", matcher_}}};
    recording.emplace(record_folder->path(), std::move(session), keep_frames_);
    setup.recording = &*recording;
  }

  EstimatesCsv csv(staging.path() / "estimates.csv");
  ReplayedFlight flown = replay_flight(flight, setup, truth, csv, context.progress);
  if (recording) {
    recording->close();
    record_folder->commit();
  }
  std::filesystem::remove_all(unpacked);
  write_refined(staging.path() / "refined.csv", flown.refined);

  const std::vector<Estimate> estimates = estimates_of(flown.frames);
  const Summary summary{score(estimates, truth, frame), score(flown.refined, truth, frame), peak_memory_mb()};
  nlohmann::json document = json_from(summary);
  write_file_atomic(staging.path() / "summary.json", document.dump(2) + "\n");
  write_file_atomic(staging.path() / "track.geojson", track_geojson(estimates, flown.refined, truth));

  ReportInput report{
      .title = "Replay of " + (recorder_ ? "session " + recorded->session.id : name_of_flight(*frames_)),
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

  std::optional<Reproduction> reproduction;
  if (recorded) reproduction = compare_estimates(recorded->estimates, flown.told);
  if (reproduction) document["reproduced"] = json_from(*reproduction);
  if (context.json) {
    print_json(context.out, document);
  } else {
    print_figures(context.out, report.figures);
    context.out << "report  " << (out_ / "report.html").string() << '\n';
    if (reproduction) print_reproduction(context, *reproduction);
  }
  // Tiles that failed their digest in flight were treated as missing; whoever flies this package must know.
  if (package && !package->imagery().findings().empty()) {
    print_findings(context.err, package->imagery().findings());
    return kRefused;
  }
  return reproduction && reproduction->same != reproduction->compared ? kRefused : kAccepted;
}

}  // namespace nadir
