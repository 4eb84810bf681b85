#include "nadird_command.hpp"

#include <fmt/format.h>

#include <cmath>
#include <new>
#include <nlohmann/json.hpp>
#include <opencv2/core/utility.hpp>
#include <ostream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/platform.hpp"
#include "base/printable.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "cli/terminal.hpp"
#include "estimation/second_opinion.hpp"
#include "flight/flight_service.hpp"
#include "flight/playback.hpp"
#include "nadird_client/watch.hpp"
#include "ortho/tile_key_check.hpp"
#include "package/open_package.hpp"
#include "package/package_roots.hpp"
#include "package_choice.hpp"
#include "trust/bearer_token.hpp"
#include "trust/signatures.hpp"
#include "vision/camera.hpp"
#include "vision/place_index.hpp"

namespace nadir {
namespace {

// Not kFailed, after which systemd does not restart the service (nadird.service): that is for wrong usage only.
constexpr int kServiceFailed = 70;

// How long --check waits for a camera frame and for the autopilot's heartbeat.
constexpr double kCameraCheck_s = 10, kAutopilotCheck_s = 5;

constexpr std::uint64_t kMostAirframeBytes = std::uint64_t{1} << 20;

// An unreadable file counts as an invalid signature, not as a missing one.
std::optional<Bytes> envelope_beside(const std::filesystem::path& airframe) {
  const std::filesystem::path file = airframe.string() + ".sig";
  if (!std::filesystem::exists(std::filesystem::symlink_status(file))) return std::nullopt;
  try {
    return read_file(file, kMaxEnvelopeSize);
  } catch (const Error&) {
    return Bytes();
  }
}

Figures readiness(const OpenPackage& package) {
  const Manifest& manifest = package.manifest();
  const ZoomRange zooms = package.imagery().zooms();
  return {
      {"ready", "yes"},
      {"mission", fmt::format("{} (series {}, sequence {})", manifest.mission_id, manifest.series, manifest.sequence)},
      {"valid until", to_rfc3339(manifest.expires)},
      {"map tiles", fmt::format("{}, zoom {} to {}", package.imagery().sidecars().size(), zooms.min, zooms.max)},
      {"terrain", package.terrain() != nullptr ? "elevation model" : "flat ground"}};
}

// Whether the service will know that the autopilot uses its position.
std::string parameters_listed(const Airframe& airframe) {
  if (airframe.parameters.empty()) {
    return "none in the airframe file: the operator will read that the autopilot may not use our position; `nadir "
           "provision autopilot` lists them";
  }
  return fmt::format("{} in the airframe file, compared with the autopilot's before take-off",
                     airframe.parameters.size());
}

}  // namespace

std::string_view NadirdCommand::details() const {
  return R"(Verifies the mission package as before take-off (signature, files, dates, airframe, sequence), then
flies with it until SIGTERM: camera frames and telemetry from the autopilot become GPS_INPUT. If
the package is rejected, the service reports it and sends no position.

--check verifies the package and exits. With --camera it also waits for a frame of the airframe's
size, with --autopilot for a heartbeat of the configured autopilot, and says what it found.

--state is a folder for what must survive a restart; with --check it may be a file with only the
record of accepted packages. A damaged record or permit rejects the package.

--play shows a recorded flight on the page on which it was watched: play, pause, speed, any moment.
Nothing flies then: no link, no camera, nothing is written. With --package, which must be the one
that was flown, the map is below it.

A service that is started again in flight resumes the package that was accepted before take-off,
without asking the clock or its dates again.

Exit codes: 0 clean shutdown, or ready (--check), 1 the package was rejected, camera or autopilot is
missing (--check), or there is no position (--status), 2 wrong usage (with --check, --status and
--play also: the job could not be done), 70 any other failure of the service: restart it.)";
}

std::string_view NadirdCommand::examples() const {
  return R"(nadird --package /data/valley --trust /etc/nadir/root.json --airframe mini-07 --state /var/lib/nadir/state.json --check
nadird --package /data/valley --trust /etc/nadir/root.json --airframe /etc/nadir/airframe.json --state /var/lib/nadir --camera folder:/run/camera --autopilot serial:/dev/ttyAMA0:921600 --signing-key /etc/nadir/link.key --ground-station udpout:192.168.4.2:14550 --record /data/flights
nadird --status
nadird --play /data/flights --package /data/valley)";
}

void NadirdCommand::setup(Options& options) {
  options.value("--package", package_, "PACKAGE", "mission package");
  request_.setup(options, VerifyRequest::Trust::optional);
  options.flag("--check", check_, "check package, camera and autopilot, and exit");
  options.flag("--status", status_, "show the status of the running service and exit");
  options.value("--play", played_, "RECORDING",
                "show a recorded flight: a folder of the recorder, or one of its files");
  options.value("--session", session_, "ID", "which one of the recording; default: the newest").needs("--play");
  options.flag("--unsigned-airframe", unsigned_airframe_,
               "for bench tests: run although the airframe file is not signed");
  options.value("--camera", flight_.camera, "SOURCE",
                "folder:DIR, video:FILE, v4l2:/dev/video0, rtsp://…, gstreamer:PIPELINE or mavlink:COMPONENT");
  options
      .value("--camera-credentials", flight_.camera_credentials, "FILE", "USER:PASSWORD of a network camera, mode 0600")
      .needs("--camera");
  options.value("--autopilot", flight_.autopilot, "URL",
                "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD");
  options.value("--signing-key", flight_.link_key, "FILE", "signing key of the link: 64 hexadecimal digits");
  options.flag("--unsigned-link", unsigned_link_,
               "for simulators and the bench: accept every sender on the links, instead of --signing-key");
  options.values("--ground-station", ground_stations_, "URL",
                 "also serve a ground station: texts for it, commands from it");
  options.values("--logger", loggers_, "URL", "also send everything that is sent to this address");
  options.value("--record", flight_.recording.folder, "DIR", "record the flight in this folder");
  options.flag("--keep-frames", flight_.recording.keep_pictures, "record the frames' images as well")
      .formerly("--keep-pictures");
  options
      .value("--candidates", flight_.candidates.folder, "DIR",
             "make signed candidate tiles from the flight, in this folder")
      .needs("--tile-key");
  options.value("--tile-key", flight_.candidates.tile_key, "KEY.pem", "private tile key of the airframe")
      .needs("--candidates");
  options.value("--candidates-mb", flight_.candidates.budget_mb, "MB", "maximum size of all tiles")
      .between(1, 1'000'000)
      .needs("--candidates");
  options.value("--candidates-percent", flight_.candidates.percent, "N", "share of one core for making them")
      .between(1, 100)
      .needs("--candidates");
  options
      .value("--candidates-frame-ms", flight_.candidates.frame_ms, "MS",
             "maximum time for the tiles of one frame; 0: no limit")
      .between(0, 60'000)
      .needs("--candidates");
  options.value("--listen", flight_.api.address, "ADDRESS", "address of the API and the web page");
  options
      .value("--token-file", flight_.api.token, "FILE", "bearer token for clients; required to listen beyond loopback")
      .formerly("--token");
  options.value("--start", flight_.start, "LON,LAT", "start of the flight; default: search the mission's area");
  options
      .value("--anchor-every-m", flight_.anchor_every_m, "M",
             "match to the map after this distance while the position is certain; 0: every frame")
      .between(0, 10'000)
      .formerly("--anchor-every");
  options
      .value("--second-matcher", second_matcher_, "WHEN",
             "when the matcher that the airframe file names looks as well: auto, always or never")
      .one_of({"auto", "always", "never"});
  options.flag("--inertial", flight_.inertial,
               "carry the position by the autopilot's raw inertial samples where the camera sees nothing");
  options.value("--memory-mb", memory_mb_, "MB", "memory to reserve at the start for the flight; 0: none")
      .between(0, 4096);
  options.flag("--switch-gps", flight_.switch_gps,
               "PX4: take GPS out of its filter while it is denied or spoofed (EKF2_GPS_CTRL)");
  options.flag("--external-position", flight_.send_external_position,
               "also send MAV_CMD_EXTERNAL_POSITION_ESTIMATE for each anchor");
  options.alternative("--play", {"--session", "--package", "--listen", "--token-file", "--quiet"});
}

int NadirdCommand::run(Context& context) {
  if (status_) {
    const NadirdClient service("http://" + flight_.api.address,
                               flight_.api.token ? read_bearer_token(*flight_.api.token) : std::string());
    return show_once(service, context.out, context.json);
  }
  if (played_) return play(context);
  if (package_.empty())
    throw UsageError({.what = "--package PACKAGE is required", .fix = "`nadird --help` lists the options"});
  return check_ ? check(context) : serve(context);
}

// The airframe file gives the id; the state folder holds the record of accepted packages.
void NadirdCommand::complete_request() {
  if (request_.airframe() && std::filesystem::path(*request_.airframe()).extension() == ".json") {
    airframe_file_ = *request_.airframe();
  }
  if (request_.state() && request_.state()->extension() != ".json") {
    flight_.state = *request_.state();
    std::error_code error;  // the service tries again, and --check fails when it writes
    std::filesystem::create_directories(flight_.state, error);
    request_.set_state_file(flight_.state / "aircraft.json");
  }
}

// What was accepted with the package counts in flight, and where the file itself is damaged.
void NadirdCommand::read_airframe(const AcceptanceReading& accepted, const std::string& boot_id) {
  if (airframe_file_.empty()) return;
  const bool holds = accepted.record && accepted.record->holds(boot_id);
  const std::string kept = holds ? accepted.record->current.airframe_file : std::string();
  airframe_notice_.clear();
  std::string text;
  try {
    text = read_text_file(airframe_file_, kMostAirframeBytes);
    if (holds && accepted.record->airborne && !kept.empty() && text != kept) {
      throw Error({.what = "not the file that was accepted for this flight", .where = airframe_file_});
    }
    flight_.airframe = parse_airframe(text, airframe_file_.string());
  } catch (const Error& error) {
    if (kept.empty()) throw;
    flight_.airframe = parse_airframe(kept, "the accepted airframe");
    airframe_notice_ =
        fmt::format("the accepted airframe is used instead of {}: {}", airframe_file_.string(), error.text().what);
    text = kept;
  }
  airframe_text_ = std::move(text);
  request_.set_airframe(flight_.airframe.id);
}

// An unsigned link must be chosen explicitly.
void NadirdCommand::complete_link() {
  if (flight_.link_key.has_value() == unsigned_link_) {
    throw UsageError(
        {.what = unsigned_link_ ? "--signing-key and --unsigned-link exclude each other"
                                : "the autopilot link would not be signed",
         .expected = "--signing-key FILE, or --unsigned-link for a simulator or the bench",
         .fix = "on an unsigned link anybody can pose as the autopilot; `nadir provision autopilot` installs a key"});
  }
  const auto add = [&](StationRole role, const std::vector<std::string>& urls) {
    for (const std::string& url : urls) {
      static_cast<void>(parse_endpoint(url));
      flight_.stations.push_back({role, url});
    }
  };
  add(StationRole::ground_station, ground_stations_);
  add(StationRole::logger, loggers_);
}

// By the newest root that package or state lead to: it may have revoked the signer.
Findings NadirdCommand::evaluate_airframe(const Opening& opening, const VerifyOptions& options) {
  if (airframe_file_.empty()) return {};
  const std::optional<Bytes> envelope = envelope_beside(airframe_file_);
  Findings findings =
      check_airframe(opening.newest_root, as_bytes(airframe_text_), envelope, options.at,
                     unsigned_airframe_ ? UnsignedAirframe::allowed : UnsignedAirframe::refused_when_signers_are_known,
                     airframe_file_.string() + ".sig");
  const bool is_signed = envelope && !findings.has_errors();
  const Airframe& airframe = flight_.airframe;
  request_.set_airframe_sequence(is_signed ? airframe.sequence : std::nullopt);
  const Findings age = check_airframe_age({airframe.id, airframe.sequence, airframe.expires}, options.state, options.at,
                                          airframe_file_.string());
  for (const Finding& finding : age.items()) {
    // That it is unsigned has been reported; on the bench its age does not matter either.
    if (!envelope && (unsigned_airframe_ || finding.code == "airframe.undated")) continue;
    findings.add(finding);
  }
  return findings;
}

// Tiles that the service would not accept are not made. Before take-off a wrong key is an error; a service that starts,
// perhaps again in flight, runs without tiles: positions matter more.
Findings NadirdCommand::evaluate_tile_key(const TrustRoot& newest_root, UtcTime at) {
  if (!flight_.candidates.tile_key) return {};
  if (!request_.airframe()) {
    throw UsageError({.what = "--tile-key requires --airframe",
                      .expected = "the airframe whose tiles it signs",
                      .fix = "add --airframe FILE.json"});
  }
  const PublicKey key = PrivateKey::read(*flight_.candidates.tile_key).public_key();
  const Findings findings =
      check_tile_key(newest_root, *request_.airframe(), key, at, flight_.candidates.tile_key->string());
  Findings found;
  for (Finding finding : findings.items()) {
    if (!check_) finding.severity = Severity::warning;
    found.add(std::move(finding));
  }
  tile_key_refused_ = !found.empty();
  return found;
}

// Accepting: all rules.
Opening NadirdCommand::open_verified(Context& context, const std::filesystem::path& package) {
  const VerifyOptions options = request_.open(context.clock);
  Opening opening = open_package(package, options, context.progress);
  verify_place_index(options.depth, context.progress, opening);
  opening.findings.add(request_.findings());
  opening.findings.add(evaluate_airframe(opening, options));
  if (opening.package) opening.findings.add(evaluate_tile_key(opening.newest_root, options.at));
  if (opening.findings.has_errors()) opening.package.reset();
  return opening;
}

// Resuming: only whether it is the accepted one, and whole. Tiles need the root to confirm their key; without
// it there are no tiles.
Opening NadirdCommand::resume(Context& context, const std::filesystem::path& package, const AcceptedPackage& accepted) {
  Opening opening = open_accepted_package(package, accepted.manifest, accepted.accepted_at, context.progress);
  verify_place_index(VerifyDepth::quick, context.progress, opening);
  if (opening.findings.has_errors()) opening.package.reset();
  if (!opening.package || !flight_.candidates.tile_key) return opening;
  try {
    const VerifyOptions options = request_.open(context.clock);
    const RootSuccession roots =
        walk_package_roots(opening.package->folder(), *options.root, options.state, accepted.accepted_at);
    opening.findings.add(evaluate_tile_key(roots.root, accepted.accepted_at));
  } catch (const Error& error) {
    tile_key_refused_ = true;
    opening.findings.add({.code = "key.unknown",
                          .severity = Severity::warning,
                          .where = flight_.candidates.tile_key->string(),
                          .expected = "a tile key that the root of trust names",
                          .found = error.text().what});
  }
  return opening;
}

PackageChoice NadirdCommand::choose(Context& context, const AcceptanceReading& accepted, const std::string& boot_id) {
  tile_key_refused_ = false;
  return choose_package(
      package_, accepted, boot_id,
      {[&](const auto& package) { return open_verified(context, package); },
       [&](const auto& package, const AcceptedPackage& earlier) { return resume(context, package, earlier); }});
}

// A large package takes a while to verify. Nothing: SIGTERM came first.
std::optional<PackageChoice> NadirdCommand::choose_unless_stopped(Context& context, const AcceptanceReading& accepted,
                                                                  const std::string& boot_id,
                                                                  const std::stop_token& stop) {
  const std::stop_callback on_stop(stop, [] { request_interrupt(true); });
  try {
    return choose(context, accepted, boot_id);
  } catch (const Interrupted&) {
    request_interrupt(false);
    if (!context.quiet) context.err << "stopped before the package was verified\n";
    return std::nullopt;
  }
}

PartCheck NadirdCommand::check_camera_source() const {
  std::optional<CameraModel> camera;
  if (!airframe_file_.empty()) camera = flight_.airframe.camera.camera;
  const auto& secret = flight_.camera_credentials;
  std::string named = flight_.camera;
  if (const auto streamed = mavlink_camera(named)) {
    if (flight_.autopilot.empty()) {
      throw UsageError(
          {.what = "a MAVLink camera is asked through the autopilot's link", .expected = "--autopilot URL"});
    }
    CheckedLink link = open_link();
    VideoStreamFinder finder(flight_.airframe.system, *streamed, camera ? camera->width : 0,
                             camera ? camera->height : 0);
    if (PartCheck part = find_stream(std::move(link.transport), flight_.airframe, std::move(link.signing), finder,
                                     flight_clock(), kCameraCheck_s);
        part.findings.has_errors()) {
      return part;
    }
    named = finder.uri();
  }
  const auto source = open_camera(secret ? with_credentials(named, *secret) : named, flight_clock());
  return check_camera(*source, camera, flight_clock(), kCameraCheck_s);
}

// Timestamps of signatures are never used twice: with a state folder they go on from its file.
NadirdCommand::CheckedLink NadirdCommand::open_link() const {
  const FlightClock& clock = flight_clock();
  CheckedLink link;
  if (flight_.link_key) {
    if (flight_.state.empty())
      link.scratch = std::make_unique<StagingDirectory>(std::filesystem::temp_directory_path() / "nadird-check");
    const std::filesystem::path folder = link.scratch ? link.scratch->path() : flight_.state;
    link.time = std::make_unique<SigningTime>(folder / "signing-time", clock.unix_us(),
                                              std::llround(clock.monotonic_s() * 1e6));
    link.signing.emplace(SigningKey::read(*flight_.link_key), *link.time, flight_.airframe.link);
  }
  link.transport = make_transport(parse_endpoint(flight_.autopilot));
  return link;
}

// The model that the airframe names. What is wrong with it is a warning: the flight goes on without.
PartCheck NadirdCommand::open_second_matcher() {
  flight_.second_matcher = nullptr;
  flight_.second_matcher_use = second_matcher_use(second_matcher_).value_or(SecondMatcherUse::automatic);
  const auto& named = flight_.airframe.matcher;
  if (!named) return {.found = "none"};
  if (flight_.second_matcher_use == SecondMatcherUse::never) return {.found = "not used: --second-matcher never"};
  SecondMatcherCheck check = check_second_matcher({airframe_file_.parent_path() / named->model, named->sha256},
                                                  plugin_folders(), thread_processor_s);
  flight_.second_matcher = std::move(check.network);
  return {std::move(check.found), std::move(check.findings)};
}

PartCheck NadirdCommand::check_autopilot_link() const {
  CheckedLink link = open_link();
  return check_autopilot(std::move(link.transport), flight_.airframe, std::move(link.signing), flight_clock(),
                         kAutopilotCheck_s);
}

int NadirdCommand::check(Context& context) {
  complete_request();
  read_airframe({}, {});
  if (!flight_.autopilot.empty()) complete_link();
  Opening opening = open_verified(context, package_);
  if (opening.package && request_.remembers()) request_.record_acceptance(opening.package->manifest(), opening);
  std::string camera = "not checked: no --camera", autopilot = "not checked: no --autopilot", second_matcher;
  const std::string parameters =
      airframe_file_.empty() ? "not checked: no airframe file" : parameters_listed(flight_.airframe);
  const auto note = [&](PartCheck part, std::string& found) {
    found = part.found;
    opening.findings.add(part.findings);
  };
  note(open_second_matcher(), second_matcher);
  if (!flight_.camera.empty()) note(check_camera_source(), camera);
  if (!flight_.autopilot.empty()) note(check_autopilot_link(), autopilot);
  if (!opening.package || opening.findings.has_errors()) {
    return report_findings(context.out, context.json, opening.findings);
  }
  const Manifest& manifest = opening.package->manifest();
  if (context.json) {
    return report_findings(context.out, true, opening.findings,
                           {{"ready", true},
                            {"mission", manifest.mission_id},
                            {"series", manifest.series},
                            {"sequence", manifest.sequence},
                            {"expires", to_rfc3339(manifest.expires)},
                            {"tiles", opening.package->imagery().sidecars().size()},
                            {"camera", camera},
                            {"autopilot", autopilot},
                            {"parameters", parameters},
                            {"second_matcher", second_matcher}});
  }
  if (!opening.findings.empty()) print_findings(context.err, opening.findings);
  Figures figures = readiness(*opening.package);
  figures.insert(
      figures.end(),
      {{"camera", camera}, {"autopilot", autopilot}, {"parameters", parameters}, {"second matcher", second_matcher}});
  print_figures(context.out, figures);
  return kAccepted;
}

void NadirdCommand::require_service_options() const {
  const auto require = [](bool there, const char* option) {
    if (!there)
      throw UsageError({.what = std::string(option) + " is required", .fix = "`nadird --help` lists the options"});
  };
  require(!airframe_file_.empty(), "--airframe FILE.json");
  require(!flight_.state.empty(), "--state DIR");
  require(!flight_.camera.empty(), "--camera SOURCE");
  require(!flight_.autopilot.empty(), "--autopilot URL");
}

// What the service needs to know of the choice, and what it keeps. accepted: becomes what is accepted now.
VerifiedPackage NadirdCommand::prepared(Context& context, PackageChoice choice, AcceptanceReading& accepted,
                                        const std::string& boot_id, const std::stop_token& stop) {
  VerifiedPackage verified;
  verified.root_version = choice.resumed ? 0 : choice.opening.root_version;
  if (choice.opening.package && !choice.resumed && request_.remembers()) {
    const bool airborne = accepted.record && accepted.record->airborne;
    const Manifest& manifest = choice.opening.package->manifest();
    accepted = {
        accepted_next(accepted.record,
                      accepted_package(choice.folder, manifest, request_.evaluated_at(), airframe_text_), boot_id),
        {}};
    accepted.record->airborne = airborne;
    request_.remember(manifest, choice.opening.root_version, choice.opening.newer_roots, choice.opening.time_reset);
    verified.write_memory = [this] { request_.write_memory(); };
    if (choice.opening.time_reset) {  // the link's time may be as wrong; it gets the right one from the peers
      std::error_code error;
      for (const auto& entry : std::filesystem::directory_iterator(flight_.state, error)) {
        if (entry.path().filename().string().starts_with("signing-")) std::filesystem::remove(entry.path(), error);
      }
    }
  }
  if (!airframe_notice_.empty()) choice.notice += (choice.notice.empty() ? "" : "; ") + airframe_notice_;
  verified.findings = std::move(choice.opening.findings);
  verified.folder = choice.folder;
  verified.acceptance = accepted.record;
  verified.resumed = choice.resumed;
  verified.notice = std::move(choice.notice);
  verified.notice_text = std::move(choice.notice_text);
  verified.package = std::move(choice.opening.package);
  if (verified.package) return verified;
  verified.can_be_opened = [this, &context, accepted, boot_id, stop] {
    const std::stop_callback on_stop(stop, [] { request_interrupt(true); });
    try {
      return choose(context, accepted, boot_id).opening.package != nullptr;
    } catch (const Interrupted&) {
      request_interrupt(false);
    } catch (const std::exception&) {  // as before: still none
    }
    return false;
  };
  return verified;
}

// Only wrong usage ends the service for good: after any other error systemd starts it again.
int NadirdCommand::serve(Context& context) {
  complete_request();
  require_service_options();
  complete_link();
  try {
    return fly(context);
  } catch (const UsageError&) {
    throw;
  } catch (const std::bad_alloc&) {
    context.err << "nadird failed: out of memory\n";
    return kServiceFailed;
  } catch (const std::exception& error) {
    context.err << "nadird failed: " << printable_lines(error.what()) << '\n';
    return kServiceFailed;
  }
}

int NadirdCommand::fly(Context& context) {
  const auto log = [&context](const std::string& line) {
    if (!context.quiet) context.err << "nadird: " << line << std::endl;
  };
  flight_.package = package_;
  try {
    hold_memory(static_cast<std::size_t>(memory_mb_));
  } catch (const Error& error) {
    log(std::string("flying without reserved memory: ") + error.what());
  }
  // Before any other thread starts: threads inherit the blocked signals.
  StopSignals stop;
  cv::setNumThreads(1);  // we have our own threads: one for odometry, one for map matching
  const FlightClock& clock = flight_clock();
  AcceptanceReading accepted = StateDirectory(flight_.state).load_acceptance();
  for (;;) {
    read_airframe(accepted, clock.boot_id());
    std::optional<PackageChoice> choice = choose_unless_stopped(context, accepted, clock.boot_id(), stop.token());
    if (!choice) return kAccepted;
    if (!choice->rejected.empty()) print_findings(context.err, choice->rejected);
    if (!choice->opening.findings.empty()) print_findings(context.err, choice->opening.findings);
    if (const PartCheck second = open_second_matcher(); !second.findings.empty()) {
      print_findings(context.err, second.findings);
      choice->notice += (choice->notice.empty() ? "" : "; ") + ("second matcher " + second.found);
    }
    FlightOptions options = flight_;
    if (tile_key_refused_) options.candidates.folder.reset();
    FlightService service(options, prepared(context, *std::move(choice), accepted, clock.boot_id(), stop.token()),
                          clock, stop, log);
    const FlightEnd end = service.run();
    if (!context.quiet) context.err << printable(service.summary()) << '\n';
    if (end == FlightEnd::stopped) return kAccepted;
    accepted = {service.acceptance(), {}};
    log("the package is judged again");
  }
}

int NadirdCommand::play(Context& context) {
  const FlightClock& clock = flight_clock();
  PlaybackSource source{.recording = *played_, .session = session_};
  if (!package_.empty()) source.package = package_;
  Playback playback(source, fmt::format("{:x}", clock.unix_us()), context.progress);
  if (!context.quiet && !playback.notice().empty())
    context.err << "nadird: not all of the recording can be read: " << printable(playback.notice()) << '\n';
  StopSignals stop;  // before any other thread starts
  if (interrupt_requested()) return kAccepted;
  serve_playback(playback, flight_.api, clock, stop.token(), [&](std::uint16_t port) {
    const std::string_view address = flight_.api.address;
    const std::string_view host = address.substr(0, address.rfind(':'));
    if (!context.quiet)
      context.err << fmt::format("nadird: the recording is played at http://{}:{}/", host, port) << std::endl;
  });
  return kAccepted;
}

}  // namespace nadir
