#include "replay/flight_request.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <ostream>
#include <string>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/platform.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "estimation/localizer.hpp"
#include "estimation/second_opinion.hpp"
#include "ortho/candidate_sidecar.hpp"
#include "recorder/record_codec.hpp"
#include "trust/root.hpp"
#include "vision/descriptor_matcher.hpp"
#include "vision/place_index.hpp"

namespace nadir {
namespace {

OdometryFactory odometry_named(std::string_view name) {
  if (name == "features") return make_feature_odometry;
  throw UsageError({.what = "unknown odometry front end",
                    .where = "--odometry",
                    .expected = "features",
                    .found = std::string(name)});
}

MapMatcherFactory matcher_named(std::string_view name) {
  if (name == "channels") return make_channel_matcher;
  throw UsageError(
      {.what = "unknown map matcher", .where = "--matcher", .expected = "channels", .found = std::string(name)});
}

}  // namespace

Opening open_flight_map(const FlightMapPaths& paths, UtcTime now, Progress& progress) {
  const TrustRoot root = read_trusted_root(paths.trust);
  VerifyOptions options;
  options.root = &root;
  options.at = now;
  options.airframe = paths.airframe;
  Opening opening = open_package(paths.package, options, progress);
  verify_place_index(options.depth, progress, opening);
  return opening;
}

std::string id_of(const Flight& flight) {
  Sha256Stream digest;
  for (const Telemetry& telemetry : flight.frames) digest.update(encode(Record(InputRecord{0, telemetry, {}, 0})));
  return digest.finish().hex().substr(0, 12);
}

void FlightRequest::declare(Options& options, Map map) {
  options.value("--frames", frames_, "DIR", "folder with the frames");
  options.value("--telemetry", telemetry_, "FILE.csv", "one row per frame, in the order of time");
  options.value("--camera", camera_, "FILE.yaml", "camera model and uncertainty of the telemetry");
  Option package = options.value("--package", package_, "PACKAGE", "the mission package to localize against");
  Option trust = options.value("--trust", trust_, "FILE.json", "root of trust for the package's signatures");
  if (map == Map::required) {
    package.required();
    trust.required();
  } else {
    package.needs("--trust");
    trust.needs("--package");
  }
  options.value("--airframe", airframe_, "ID", "the package must be made for this airframe").needs("--package");
  options.value("--at", at_, "TIME", "evaluate validity as of this time; the present by default");
  options.value("--start", start_, "LON,LAT",
                "position of the first frame; without it the whole mission area is searched");
  options.value("--odometry", odometry_, "NAME", "visual odometry: features (SIFT)").one_of({"features"});
  options.value("--matcher", matcher_, "NAME", "map matching: channels (oriented gradients)")
      .one_of({"channels"})
      .needs("--package");
  options
      .value("--matcher-model", matcher_model_, "FILE.onnx",
             "a descriptor network: a second matcher, which looks where the first one is in doubt")
      .needs("--package");
  options.value("--second-matcher", second_matcher_, "WHEN", "when it looks: auto, always or never")
      .one_of({"auto", "always", "never"})
      .needs("--matcher-model");
  options.value("--recorder", recorder_, "DIR",
                "replay a recording of the flight recorder instead of --telemetry and --camera");
  options.value("--session", session_, "ID", "of the recording, when it holds several").needs("--recorder");
}

void FlightRequest::check() const {
  if (recorder_) {
    if (telemetry_ || camera_ || start_) {
      throw UsageError({.what = command_ + " --recorder takes telemetry, camera and start from the recording",
                        .fix = "leave out --telemetry, --camera and --start"});
    }
    return;
  }
  if (!frames_ || !telemetry_ || !camera_) {
    throw UsageError({.what = command_ + " needs a flight",
                      .expected = "--frames, --telemetry and --camera, or --recorder",
                      .fix = command_ + " --help shows examples"});
  }
  if (!start_ && !package_) {
    throw UsageError({.what = command_ + " without --package needs --start LON,LAT",
                      .expected = "the position of the first frame: odometry alone cannot find it",
                      .fix = "give --start, or a map with --package and --trust"});
  }
}

Flight FlightRequest::flight_to_fly(Context& context, const std::filesystem::path& unpacked,
                                    std::optional<RecordedFlight>& recorded) {
  if (recorder_) {
    recorded = read_recorded_flight({*recorder_, session_, frames_, unpacked});
    if (recorded->unusable_inputs != 0 && !context.quiet) {
      context.err << fmt::format("note: skipped {} after a missing one\n", count(recorded->unusable_inputs, "input"));
    }
    const bool mapped = recorded->session.package.has_value();
    const std::optional<Sha256> package =
        package_ ? std::optional(sha256_file(*package_ / "manifest.json")) : std::nullopt;
    if (package != recorded->session.package) {
      throw UsageError({.what = "the flight was recorded with another map",
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
  if (flight.images_without_row != 0 && !context.quiet) {
    context.err << fmt::format("note: skipped {} without a row in {}\n", count(flight.images_without_row, "image"),
                               paths.telemetry.string());
  }
  return flight;
}

std::unique_ptr<ReadyFlight> FlightRequest::open(Context& context, const std::filesystem::path& unpacked) {
  auto ready = std::make_unique<ReadyFlight>();
  ready->flight = flight_to_fly(context, unpacked, ready->recorded);
  if (ready->recorded) {
    start_ = ready->recorded->session.start;
    for (const auto& [name, value] : ready->recorded->session.settings) {
      if (name == "odometry") odometry_ = value;
      if (name == "matcher") matcher_ = value;
    }
  }
  ReplaySetup setup{.frame = LocalFrame(ready->recorded ? ready->recorded->session.origin : start_.value_or(LonLat{})),
                    .tiles = nullptr,
                    .start = start_,
                    .integrity_risk = std::nullopt,
                    .area = std::nullopt,
                    .surface = nullptr,
                    .places = nullptr,
                    .matchability = nullptr,
                    .odometry = odometry_named(odometry_),
                    .matcher = matcher_named(matcher_),
                    .recording = nullptr,
                    .recorded = ready->recorded ? &*ready->recorded : nullptr};
  if (package_) {
    Opening opening =
        open_flight_map({*package_, *trust_, airframe_}, evaluation_time(at_, context.clock), context.progress);
    if (!opening.package) {
      ready->findings = std::move(opening.findings);
      return ready;
    }
    ready->package = std::move(opening.package);
    const OpenPackage& package = *ready->package;
    setup.frame = mission_frame(package.mission());
    setup.area = required_region(package.mission(), setup.frame).bounds();
    setup.integrity_risk = package.mission().integrity.risk;
    setup.tiles = &package.imagery();
    ready->places = PlaceIndex::open(package.folder(), package.manifest());
    if (ready->places) setup.places = &*ready->places;
    setup.matchability = package.matchability();
    if (package.terrain() != nullptr) {
      setup.surface = &ready->surface.emplace(*package.terrain(), setup.frame, package.mission().terrain.height_m);
      setup.ground_msl_m = ready->surface->msl_m(start_.value_or(setup.frame.lonlat_from_plane(setup.area->middle())));
    } else if (package.mission().terrain.height_m != 0) {
      setup.ground_msl_m = package.mission().terrain.height_m;
    }
  }
  add_second_matcher(context, ready->recorded, setup);
  ready->setup.emplace(std::move(setup));
  return ready;
}

// A replay goes on without a second matcher that cannot be used, as a flight does.
void FlightRequest::add_second_matcher(Context& context, const std::optional<RecordedFlight>& recorded,
                                       ReplaySetup& setup) {
  if (matcher_model_ && second_matcher_ != "never") {
    const SecondMatcherUse use = second_matcher_use(second_matcher_).value_or(SecondMatcherUse::automatic);
    const SecondMatcherCheck check =
        check_second_matcher({*matcher_model_, std::nullopt}, plugin_folders(), thread_processor_s);
    if (!check.findings.empty()) print_findings(context.err, check.findings);
    if (check.network) {
      second_setting_ = second_matcher_setting(check.network->name(), use);
      setup.matcher = make_second_opinion(
          {.first = setup.matcher,
           .second = [network = check.network](const MatcherMap& map) { return make_descriptor_matcher(map, network); },
           .use = use,
           .on_failure =
               [&context](const std::string& reason) {
                 if (!context.quiet)
                   context.err << "note: the second matcher is not asked any more: " << reason << '\n';
               }});
    }
  }
  if (!recorded) return;
  const auto& settings = recorded->session.settings;
  const auto then = std::find_if(settings.begin(), settings.end(),
                                 [](const auto& setting) { return setting.first == "second_matcher"; });
  const std::string flown = then == settings.end() ? "none" : then->second;
  const std::string now = second_setting_ ? second_setting_->second : "none";
  if (flown == now) return;
  throw UsageError({.what = "the flight was recorded with another second matcher",
                    .where = "--matcher-model",
                    .expected = flown,
                    .found = now,
                    .fix = "give the same model and --second-matcher, or none where there was none"});
}

std::vector<std::pair<std::string, std::string>> FlightRequest::settings() const {
  std::vector<std::pair<std::string, std::string>> settings = {{"odometry", odometry_}, {"matcher", matcher_}};
  if (second_setting_) settings.push_back(*second_setting_);
  return settings;
}

PosesSubject FlightRequest::poses_subject(const ReadyFlight& ready) const {
  return {.flight = id_of(ready.flight),
          .frames = ready.flight.frames.size(),
          .base_package = sha256_file(*package_ / "manifest.json"),
          .camera = camera_digest(ready.flight.camera.camera),
          .origin = ready.setup->frame.origin()};
}

}  // namespace nadir
