// `nadir replay`: flies recorded pictures and telemetry through the localizer and reports how it went.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "base/platform.hpp"
#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/nadir_version.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "commands/recorder/flight_tables.hpp"
#include "flight_adjustment/flight_adjustment.hpp"
#include "flight_adjustment/reconstruction_files.hpp"
#include "flights/flight_engine.hpp"
#include "flights/flight_store.hpp"
#include "flights/no_fix_diagnosis.hpp"
#include "geodesy/angles.hpp"
#include "replay/flight_request.hpp"
#include "replay/replay_flight.hpp"
#include "replay/replayed_fixes.hpp"
#include "replay/report.hpp"
#include "replay/score.hpp"
#include "replay/track_files.hpp"

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
    const PlanePoint at = frame.plane_from_lonlat(*place);
    if (!box) box = PlaneBox{at.east_m, at.north_m, at.east_m, at.north_m};
    box->west_m = std::min(box->west_m, at.east_m);
    box->east_m = std::max(box->east_m, at.east_m);
    box->south_m = std::min(box->south_m, at.north_m);
    box->north_m = std::max(box->north_m, at.north_m);
  };
  for (const Estimate& estimate : estimates) include(estimate.position);
  for (const auto& place : truth) include(place);
  return box;
}

std::string name_of_flight(const std::filesystem::path& frames) {
  const auto folder = std::filesystem::weakly_canonical(frames);
  return folder.filename() == "frames" ? folder.parent_path().filename().string() : folder.filename().string();
}

void print_reproduction(Context& context, const Reproduction& result) {
  context.out << fmt::format("reproduced  {} of {} recorded estimates bit for bit\n", result.same, result.compared);
  if (!result.first_other) return;
  context.err << fmt::format("first estimate that differs: frame {}\n", printable(*result.first_other));
}

constexpr std::size_t kShownIntervals = 5;

// Nothing for a recording without fixes: that of a replay.
std::optional<ReplayedFixes> replayed_fixes(const std::optional<RecordedFlight>& recorded, const ReplayedFlight& flown,
                                            const std::optional<TerrainSurface>& terrain) {
  if (!recorded || (recorded->fixes.empty() && recorded->fix_inputs.empty())) return std::nullopt;
  return replay_fixes(*recorded, flown.published, terrain ? &*terrain : nullptr);
}

std::size_t not_compared(const FixComparison& result) {
  std::size_t fixes = 0;
  for (const FixComparison::Interval& interval : result.not_compared) fixes += interval.fixes;
  return fixes;
}

void print_fixes(Context& context, const FixComparison& result) {
  context.out << fmt::format("fixes       {} of {} identical", result.identical, result.compared);
  const std::size_t left_out = not_compared(result);
  if (left_out != 0) context.out << fmt::format(", {} not compared", left_out);
  context.out << '\n';
  if (result.first) context.err << text_of(*result.first) << '\n';
  const auto& intervals = result.not_compared;
  for (std::size_t i = 0; i < std::min(intervals.size(), kShownIntervals); ++i) {
    context.err << text_of(intervals[i]) << '\n';
  }
  if (intervals.size() > kShownIntervals) {
    context.err << fmt::format("and {} more such intervals: see --json\n", intervals.size() - kShownIntervals);
  }
}

nlohmann::json json_from(const FixComparison& result) {
  nlohmann::json document{
      {"compared", result.compared}, {"identical", result.identical}, {"not_compared", nlohmann::json::array()}};
  if (const auto& first = result.first) {
    document["first_difference"] = {{"time_s", first->time_s},
                                    {"field", first->field},
                                    {"recorded", first->recorded},
                                    {"replayed", first->replayed}};
  }
  for (const FixComparison::Interval& interval : result.not_compared) {
    document["not_compared"].push_back(
        {{"from_s", interval.from_s}, {"to_s", interval.to_s}, {"fixes", interval.fixes}, {"reason", interval.reason}});
  }
  return document;
}

nlohmann::json json_from(const Reproduction& result) {
  nlohmann::json document{{"compared", result.compared}, {"same", result.same}};
  if (result.first_other) document["first_other"] = *result.first_other;
  return document;
}

nlohmann::json json_from(const NoFixDiagnosis& diagnosis) {
  nlohmann::json document{{"cause", name_of(diagnosis.cause)},
                          {"text", diagnosis.text},
                          {"frames_tried", diagnosis.frames_tried},
                          {"frames_matched", diagnosis.frames_matched}};
  if (diagnosis.frames_matched == 0) return document;
  document["height_factor"] = rounded(diagnosis.height_factor);
  if (diagnosis.heading_offset_rad)
    document["heading_offset_deg"] = rounded(degrees(*diagnosis.heading_offset_rad), 10);
  if (diagnosis.place)
    document["place"] = {{"lat_deg", diagnosis.place->lat_deg}, {"lon_deg", diagnosis.place->lon_deg}};
  return document;
}

// What stands above the report of a flight that the map did not help, and beside the exit code.
// A report is made without vectors that cannot be read.
std::optional<VectorLayer> vectors_of(const OpenPackage& package) {
  const auto bytes = package.read_vectors();
  if (!bytes) return std::nullopt;
  try {
    return parse_vectors(*bytes, kVectorsFile);
  } catch (const Error&) {
    return std::nullopt;
  }
}

std::string notice_of(const std::optional<NoFixDiagnosis>& diagnosis) {
  return "no frame was localized on the map" + (diagnosis ? ": " + diagnosis->text : std::string());
}

void write_estimates(const std::filesystem::path& path, const std::vector<Estimate>& estimates) {
  EstimatesCsv csv(path);
  for (const Estimate& estimate : estimates) csv.write(estimate);
}

void remark(Context& context, std::string_view text) {
  if (!context.quiet) context.err << "note: " << text << '\n';
}

// Not synced at each frame: what a loss of power costs is processed again.
std::unique_ptr<FlightStore> flight_store(const std::filesystem::path& folder, const FlightDescription& flight,
                                          const std::filesystem::path& frames, bool resume) {
  const FlightStoreOptions options{.sync = StoreSync::checkpoints, .limits = {}, .outside = frames, .hook = {}};
  if (!resume) {
    std::filesystem::remove_all(folder);
    return FlightStore::create(folder, flight, system_clock_millis(), options);
  }
  auto store = FlightStore::open(folder, options);
  if (same_flight(store->description(), flight)) return store;
  throw UsageError({.what = "the interrupted replay had other inputs or options",
                    .where = folder.string(),
                    .expected = "the same camera, package, start, integrity risk and version of nadir",
                    .fix = "resume with the same inputs and options, or replay from the start without --resume"});
}

class ReplayCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "replay"; }
  std::string_view summary() const override { return "replay recorded frames and telemetry through the localizer"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  FlightRequest request_{"nadir replay"};
  std::optional<std::filesystem::path> truth_;
  std::filesystem::path out_;
  std::optional<std::filesystem::path> record_;
  bool keep_frames_ = false;
  bool resume_ = false;
  bool adjust_ = false;
  std::optional<double> integrity_risk_, alert_limit_m_;
};

std::string_view ReplayCommand::details() const {
  return R"(Reads frames, telemetry and camera of a recorded flight and localizes every frame as the aircraft
would: against a signed package if one is given, else by odometry from --start only. Ground truth is
for scoring; the localizer never sees it.

OUT receives estimates.csv, refined.csv, summary.json, track.geojson and report.html, and with a
package poses.json, from which nadir ortho --estimates makes tiles. All appear when the replay is
complete; until then the rows can be followed in the hidden folder .OUT.staging beside it. A replay
that was killed continues there with --resume and gives the same estimates; one that was begun with
--resume continues after Ctrl-C and after an error as well.

With --record the replay is recorded as the aircraft records a flight. With --recorder a recorded
flight is replayed with its recorded inputs and settings, and every estimate is compared; so is every
fix that was sent to the autopilot, and OUT receives fixes.csv.

With --adjust the flight is adjusted as a whole afterwards, with tie points from its pictures, and OUT
receives adjusted.csv and colmap/, a model for COLMAP with geo.txt for OpenDroneMap; poses.json then
has the adjusted poses.

When the first frames match nowhere, a few are tried at other heights, headings and places, and what
they match at is said: heights in feet, a wrong start, the package of another place.

Exit codes: 0 replayed, 1 the package was rejected, no frame was localized on the map, or an estimate
or a fix differs from the recorded one, 2 an input is missing or invalid.)";
}

std::string_view ReplayCommand::examples() const {
  return R"(nadir replay --package valley --trust root.json --frames flight/frames --telemetry flight/telemetry.csv --camera camera.yaml --start 8.5,47.4 --out result
nadir replay --recorder recording --package valley --trust root.json --out again
nadir replay --frames frames --telemetry telemetry.csv --camera camera.yaml --start=-83.30572,41.03467 --out odometry)";
}

void ReplayCommand::setup(Options& options) {
  request_.declare(options, FlightRequest::Map::optional);
  options.value("--out", out_, "OUT", "folder to create").required();
  options.value("--truth", truth_, "FILE.csv", "ground truth positions, for scoring only");
  options.value("--record", record_, "DIR", "folder to create: the replay as the flight recorder records it");
  options.flag("--keep-frames", keep_frames_, "record the frames' images as well").needs("--record");
  options.flag("--adjust", adjust_,
               "adjust the whole flight afterwards: tie points, looks at the map and telemetry together");
  options.flag("--resume", resume_,
               "continue a replay that was killed or interrupted, with the same inputs and options");
  options
      .value("--integrity-risk", integrity_risk_, "RISK",
             "per look, of being outside the protection level; the mission's by default, else 1e-5")
      .between(kMinIntegrityRisk, kMaxIntegrityRisk);
  options
      .value("--alert-limit-m", alert_limit_m_, "METRES",
             "largest protection level of a usable position; the mission's by default, else 100")
      .between(kMinAlertLimit_m, kMaxAlertLimit_m);
}

int ReplayCommand::run(Context& context) {
  keep_freed_memory();
  request_.check();
  if (integrity_risk_ && request_.recorder()) {
    throw UsageError({.what = "nadir replay --recorder takes the integrity risk from the recording",
                      .where = "--integrity-risk",
                      .fix = "leave it out: every estimate is compared with the recorded one"});
  }
  if (resume_ && request_.recorder()) {
    throw UsageError({.what = "nadir replay --recorder cannot be resumed",
                      .where = "--resume",
                      .fix = "leave it out: a recording is replayed from its beginning"});
  }
  if (adjust_ && request_.recorder()) {
    throw UsageError({.what = "nadir replay --recorder cannot adjust the flight",
                      .where = "--adjust",
                      .fix = "leave it out, or replay its pictures with --frames, --telemetry and --camera: a recorded "
                             "flight is replayed exactly as it was flown, and compared"});
  }
  StagingDirectory staging(out_, resume_ ? StagingDirectory::Leftovers::keep : StagingDirectory::Leftovers::discard);
  staging.keep(resume_ && staging.found_leftovers());
  const std::filesystem::path stored = staging.path() / "flight";
  const bool resumable = resume_ && FlightStore::exists(stored);
  if (resume_ && !resumable) remark(context, "nothing to resume: replaying from the start");
  if (!resume_ && staging.found_leftovers()) {
    remark(context, "discarded the files of an interrupted replay; --resume would have continued it");
  }
  const std::filesystem::path unpacked = staging.path() / "unpacked";
  std::filesystem::create_directory(unpacked);
  const auto ready = request_.open(context, unpacked);
  if (!ready->setup) return report_findings(context.out, context.json, ready->findings);
  const Flight& flight = ready->flight;
  const std::optional<RecordedFlight>& recorded = ready->recorded;
  const OpenPackage* package = ready->package.get();
  ReplaySetup& setup = *ready->setup;
  if (integrity_risk_) setup.integrity_risk = integrity_risk_;
  setup.on_no_match = [&context] {
    remark(context, "no frame has matched the map so far: trying other heights, headings and places");
  };
  setup.on_diagnosis = [&context](const NoFixDiagnosis& diagnosis) {
    if (!context.quiet) context.err << "warning: " << diagnosis.text << '\n' << std::flush;
  };
  const double alert_limit_m = alert_limit_m_.value_or(package != nullptr ? package->mission().integrity.alert_limit_m
                                                                          : IntegrityRequirement().alert_limit_m);
  const LocalFrame& frame = setup.frame;
  const Truth truth = truth_ ? read_truth(*truth_, flight.frames) : Truth(flight.frames.size());

  const SessionRecord session{
      .id = id_of(flight),
      .program = "nadir replay",
      .version = kVersion,
      .airframe = request_.airframe().value_or(""),
      .package = package != nullptr ? std::optional(sha256_file(*request_.package() / "manifest.json")) : std::nullopt,
      .mission = package != nullptr ? package->manifest().mission_id : "",
      .camera = flight.camera,
      .origin = frame.origin(),
      .start = request_.start(),
      .picture_shrink = picture_shrink(flight, setup),
      .localizer = localizer_config(setup),
      .terrain = setup.surface != nullptr,
      .places = setup.places != nullptr,
      .matchability = setup.matchability != nullptr,
      .settings = request_.settings()};
  std::optional<StagingDirectory> record_folder;
  std::optional<ReplayRecording> recording;
  if (record_) {
    record_folder.emplace(*record_);
    recording.emplace(record_folder->path(), session, keep_frames_);
    setup.recording = &*recording;
  }

  std::unique_ptr<FlightStore> store;
  if (!recorded) store = flight_store(stored, flight_description(flight, session), flight.frames_folder, resumable);
  setup.store = store.get();
  staging.keep(resume_);
  std::optional<AdjustedFlight> adjusted;
  if (adjust_) {
    setup.on_flown = [&](const FlightStore& flown, FlightEngine& engine, const FlightEngineSetup& made_of) {
      context.progress.end();
      adjusted = adjust_flight(flight_to_adjust(flown, engine, made_of), context.progress);
    };
  }
  EstimatesCsv csv(staging.path() / "estimates.csv");
  ReplayedFlight flown = replay_flight(flight, setup, truth, &csv, context.progress);
  if (recording) {
    recording->close();
    record_folder->commit();
  }
  if (flown.restored != 0) remark(context, fmt::format("continued after {}", count(flown.restored, "frame")));
  store.reset();
  std::filesystem::remove_all(stored);
  std::filesystem::remove_all(unpacked);
  write_estimates(staging.path() / "refined.csv", flown.refined);
  std::optional<AdjustedLens> lens;
  if (adjusted) {
    write_estimates(staging.path() / "adjusted.csv", adjusted->estimates);
    std::filesystem::create_directory(staging.path() / "colmap");
    for (const auto& [name, text] : reconstruction_files(*adjusted, flight.camera.camera)) {
      write_file_atomic(staging.path() / "colmap" / name, text);
    }
    flown.poses = adjusted->poses;
    lens = adjusted_poses(*adjusted).lens;
  }
  if (package != nullptr) {
    write_file_atomic(staging.path() / kPosesFile,
                      poses_json(poses_document(request_.poses_subject(*ready), flight.frames, flown.poses, lens)));
  }

  const std::optional<ReplayedFixes> fixes = replayed_fixes(recorded, flown, ready->surface);
  if (fixes) write_file_atomic(staging.path() / "fixes.csv", csv_of(fixes_table(fixes->fixes)));

  const std::vector<Estimate> estimates = estimates_of(flown.frames);
  const Summary summary{.streamed = score(estimates, truth, frame),
                        .refined = score(flown.refined, truth, frame),
                        .adjusted = adjusted ? std::optional(score(adjusted->estimates, truth, frame)) : std::nullopt,
                        .integrity = integrity_figures(estimates, truth, frame, alert_limit_m),
                        .peak_memory_mb = peak_memory_mb()};
  const bool nothing_localized = package != nullptr && !recorded && summary.streamed.localized_share == 0;
  nlohmann::json document = json_from(summary);
  if (adjusted) document["adjustment"] = json_from(adjusted->summary);
  if (flown.diagnosis) document["diagnosis"] = json_from(*flown.diagnosis);
  write_file_atomic(staging.path() / "summary.json", document.dump(2) + "\n");
  write_file_atomic(staging.path() / "track.geojson", track_geojson(estimates, flown.refined, truth));

  ReportInput report{
      .title = "Replay of " + (recorded ? "session " + recorded->session.id : name_of_flight(*request_.frames())),
      .subtitle =
          fmt::format("{} · {}", count(flight.frames.size(), "frame"),
                      package != nullptr ? "map package " + package->manifest().mission_id : "odometry only, no map"),
      .frame = frame,
      .frames = std::move(flown.frames),
      .refined = std::move(flown.refined),
      .truth = truth,
      .score = summary.streamed,
      .integrity = summary.integrity,
      .figures = figures_from(summary),
      .worst = std::move(flown.worst),
      .map = std::nullopt,
      .notice = nothing_localized ? notice_of(flown.diagnosis) : std::string()};
  const auto box = box_of(estimates, truth, frame);
  if (package != nullptr && box) report.map = report_map(package->imagery(), frame, *box);
  if (report.map) report.vectors = vectors_of(*package);
  write_file_atomic(staging.path() / "report.html", report_html(report));
  staging.commit();

  std::optional<Reproduction> reproduction;
  if (recorded) reproduction = compare_estimates(recorded->estimates, flown.published);
  if (reproduction) document["reproduced"] = json_from(*reproduction);
  if (fixes) document["fixes"] = json_from(fixes->comparison);
  if (context.json) {
    print_json(context.out, document);
  } else {
    print_figures(context.out, report.figures);
    context.out << "report  " << (out_ / "report.html").string() << '\n';
    if (reproduction) print_reproduction(context, *reproduction);
    if (fixes) print_fixes(context, fixes->comparison);
  }
  // Tiles that failed their digest in flight were treated as missing; whoever flies this package must know.
  if (package != nullptr && !package->imagery().findings().empty()) {
    print_findings(context.err, package->imagery().findings());
    return kRefused;
  }
  if (nothing_localized) {
    context.err << notice_of(flown.diagnosis) << '\n';
    return kRefused;
  }
  const bool other_estimates = reproduction && reproduction->same != reproduction->compared;
  return other_estimates || (fixes && fixes->comparison.first) ? kRefused : kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_replay() { return std::make_unique<ReplayCommand>(); }

}  // namespace nadir
