// How a flight's parts are made, in their order, and how they end. What they do then: flight_service.cpp (the
// conductor) and flight_service_threads.cpp (the threads of the parts).
#include "flight/flight_service.hpp"

#include <fmt/format.h>

#include <utility>

#include "base/error.hpp"
#include "camera/open_camera.hpp"
#include "flight/flight_session.hpp"
#include "flight/leaning_attitude.hpp"
#include "trust/bearer_token.hpp"

namespace nadir {
namespace {

std::optional<Sha256> token_digest(const std::optional<std::filesystem::path>& file) {
  if (!file) return std::nullopt;
  return sha256(as_bytes(read_bearer_token(*file)));
}

Airframe by_our_fix(Airframe airframe) {
  airframe.camera.uncertainty = fix_aided_attitude(airframe.camera.uncertainty);
  return airframe;
}

}  // namespace

FlightService::FlightService(const FlightOptions& options, JudgedPackage judged, const FlightClock& clock,
                             StopSignals& stop)
    : options_(options),
      clock_(clock),
      stop_(stop),
      airframe_(by_our_fix(options.airframe)),
      state_(options.state),
      machine_(clock.monotonic_s()),
      gps_(clock.monotonic_s()),
      views_(fmt::format("{:x}", clock.unix_us())),
      manager_(read_service_environment().notify_socket),
      watch_(clock) {
  if (judged.package) ground_ = std::make_unique<FlightGround>(std::move(judged.package), options.package);
  restart_ =
      restart_from(state_.load(), clock);  // after the ground: reading a large place index takes seconds of flight
  if (restart_.position) gps_.resumed();
  const PackageView shown = ground_ ? package_view(ground_->package()) : refused_package(judged.findings);
  views_.package(shown);
  refusal_ = shown.reason;
  cautions_ = std::move(judged.findings);
  start_recorder();
  journal_ = std::make_unique<FlightJournal>(recorder_.get());

  const ListenAddress address = parse_listen_address(options.listen);
  ApiOptions api;
  api.now_s = [this] { return clock_.monotonic_s(); };
  api.token = token_digest(options.token);
  api.loopback = address.loopback();
  require_token_beyond_loopback(address, api.token);
  api_ = std::make_unique<Api>(board_, hints_, api);
  if (ground_) api_->use_package(ground_->for_api());
  server_ = std::make_unique<HttpServer>(*api_, address);
  start_flight();
  house_ = std::jthread([this](const std::stop_token& token) { save_state_loop(token); });
}

FlightService::~FlightService() {
  if (localizing_) localizing_->request_stop();  // a look at the map takes longest to end
  camera_.reset();
  link_->stop();  // the localizer still speaks to it, and it to the localizer
  localizing_.reset();
  tiles_.reset();
  house_ = {};
  link_.reset();
  server_.reset();
  if (recorder_) recorder_->close("stopped");
}

// What the localizer starts from, and what the recorder says that it started from.
LocalizingSetup FlightService::localizing_setup() const {
  LocalizingSetup setup{airframe_.camera, airframe_.mount,   ground_->frame(),      &ground_->package().imagery(),
                        options_.start,   ground_->config(), ground_->plane_msl_m()};
  setup.config.anchor_every_m = options_.anchor_every_m;
  if (restart_.position) {
    setup.start = restart_.position->place;
    setup.config.start_sigma_m = restart_.position->sigma_m;
    setup.config.resumed = true;
  }
  return setup;
}

// A recorder that cannot record costs the evidence, not the flight.
void FlightService::start_recorder() {
  if (!options_.record) return;
  RecorderOptions recorder;
  recorder.store.folder = *options_.record;
  recorder.keep_pictures = options_.keep_pictures;
  try {
    SessionRecord session = flight_session(airframe_, clock_);
    if (ground_) add_start(session, localizing_setup(), *ground_);
    recorder_ = std::make_unique<Recorder>(recorder, std::move(session),
                                           [this] { return static_cast<std::uint64_t>(clock_.unix_us()) * 1000; });
  } catch (const Error& error) {
    recorder_trouble_ = error.what();
  }
}

// Names that are wrong are found out before there are threads that speak to each other. The camera's thread comes last:
// before there is a picture nobody speaks to the link.
void FlightService::start_flight() {
  std::unique_ptr<CameraSource> camera;
  if (ground_) camera = open_camera(options_.camera, clock_);
  if (ground_) start_localizing();
  AutopilotLinkSetup link{airframe_, make_transport(parse_endpoint(options_.autopilot)), std::nullopt, std::nullopt};
  if (options_.link_key) {
    link.key = SigningKey::read(*options_.link_key);
    link.signing_time = state_.folder() / "signing-time";
  }
  link_ = std::make_unique<AutopilotLink>(
      std::move(link), clock_, watch_,
      AutopilotLink::Listener{[this](double now_s, const ReceivedMessage& message) { heard(now_s, message); },
                              [this](double metres) { tell(FixJumped{metres}); },
                              [this] {
                                tell(AutopilotEvent{false, false});
                              }});
  if (!ground_) return;
  camera_ = std::make_unique<CameraFeed>(std::move(camera), airframe_.capture_delay_s, clock_, pictures_, watch_,
                                         [this](const std::string& trouble) {
                                           tell(CameraEvent{trouble.empty(), trouble});
                                         });
}

// Wrong names, keys and folders are found out before take-off; what goes wrong later costs tiles alone.
void FlightService::start_tiles() {
  if (!options_.candidates) return;
  const LocalizerConfig config = ground_->config();
  TileMakingSetup setup{*options_.candidates,
                        options_.tile_key.value_or(""),
                        CandidateFlight{.airframe = airframe_.id,
                                        .flight = fmt::format("{:x}", clock_.unix_us()),
                                        .base_package = sha256_file(ground_->folder() / kManifestFile),
                                        .camera = airframe_.camera.camera,
                                        .frame = ground_->frame(),
                                        .surface = config.surface,
                                        .zoom = ground_->package().mission().zoom.max},
                        static_cast<std::uint64_t>(options_.candidates_mb) * 1'000'000,
                        options_.candidates_percent / 100.0,
                        options_.candidates_frame_ms / 1000.0};
  tiles_ = std::make_unique<TileMaking>(
      setup, clock_,
      TileMaking::Listener{[this](const TileKey& key, CandidateOutcome fate) {
                             if (recorder_)
                               recorder_->record(TileRecord{key, fmt::format("candidate.{}", name_of(fate)), {}});
                           },
                           [this](const std::string& trouble) { tell(TilesNotMade{trouble}); }});
}

void FlightService::start_localizing() {
  start_tiles();
  localizing_ = std::make_unique<LocalizationThread>(
      localizing_setup(), pictures_, watch_,
      LocalizationThread::Listener{[this](std::uint64_t index, const Telemetry& told, ByteView encoded) {
                             if (recorder_) record_input(*recorder_, index, told, encoded);
                             if (tiles_) tiles_->seen(index, told, encoded);
                           },
                           [this](const LocalizedFrame& frame) { localized(frame); },
                           [this](const HintRecord& hint) {
                             if (recorder_) recorder_->record(hint);
                           }});
  if (restart_.hint) localizing_->hint(restart_.hint->place, restart_.hint->radius_m, "restart");
}

}  // namespace nadir
