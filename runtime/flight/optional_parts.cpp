#include "flight/optional_parts.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "cli/nadir_version.hpp"
#include "trust/bearer_token.hpp"
#include "trust/installed_report.hpp"
#include "vision/camera_frame.hpp"

namespace nadir {
namespace {

constexpr const char* kHintToken = "api-token";  // in the state folder

// Without a readable token nobody may hint: no text is known whose digest is zero.
Sha256 hint_token_digest(const std::filesystem::path& file, std::string& failure) {
  try {
    return sha256(as_bytes(read_or_create_bearer_token(file)));
  } catch (const Error& error) {
    failure = error.what();
    return Sha256{};
  }
}

std::optional<Sha256> token_digest(const std::optional<std::filesystem::path>& file) {
  if (!file) return std::nullopt;
  return sha256(as_bytes(read_bearer_token(*file)));
}

// What the recorder writes first: the flight, and with add_start() everything that the localizer starts from, so that
// `nadir replay --recorder` starts from the same.
SessionRecord session_record(const Airframe& airframe, const FlightClock& clock) {
  const std::int64_t unix_us = clock.unix_us();
  SessionRecord session;
  session.program = "nadird";
  session.version = kVersion;
  session.airframe = airframe.id;
  session.started_ns = static_cast<std::uint64_t>(unix_us) * 1000;
  session.id = fmt::format("{}-{:x}", airframe.id, unix_us);
  session.camera = airframe.camera;
  session.picture_shrink = decode_reduction(airframe.camera.camera.width, airframe.camera.camera.height);
  session.looked_up_later = true;
  return session;
}

void add_start(SessionRecord& session, const LocalizationSetup& setup, const MissionMap& map) {
  session.package = sha256_file(map.folder() / kManifestFile);
  session.mission = map.package().manifest().mission_id;
  session.origin = setup.frame.origin();
  session.start = setup.start;
  session.localizer = setup.config;
  session.terrain = setup.config.surface != nullptr;
  session.places = setup.config.places != nullptr;
  session.matchability = setup.config.matchability != nullptr;
  session.settings = {{"odometry", "features"}, {"matcher", "channels"}};  // the defaults of LocalizerConfig
  for (const auto& [name, value] : setup.settings) session.settings.emplace_back(name, value);
}

// Each code once.
std::vector<std::string> codes_in(const Findings& findings) {
  std::vector<std::string> codes;
  for (const Finding& finding : findings.items()) {
    const bool known = std::find(codes.begin(), codes.end(), finding.code) != codes.end();
    if (!known && codes.size() < kMaxInstalledFindings) codes.push_back(finding.code);
  }
  return codes;
}

// Beside the tiles, which go to the ground. The state folder keeps the last one: the next one's number goes on from it.
void write_installed_report(InstalledReport report, const PrivateKey& key, const std::filesystem::path& state,
                            const std::filesystem::path& candidates) {
  const std::filesystem::path kept = state / kInstalledFile;
  std::optional<std::string> last;
  try {
    if (std::filesystem::exists(kept)) last = read_text_file(kept, kMaxInstalledSize);
  } catch (const Error&) {  // damaged: as if it were lost
  }
  report.number = next_report_number(last, report.reported_at);
  const std::string text = sign_installed_report(report, key).json();
  write_file_atomic(kept, text);
  write_file_atomic(candidates / kInstalledFile, text);
}

}  // namespace

OptionalParts::OptionalParts(OptionalPartsSetup setup, const FlightClock& clock, Publish publish)
    : setup_(std::move(setup)),
      address_(parse_listen_address(setup_.api.address)),
      clock_(clock),
      publish_(std::move(publish)) {
  if (!setup_.api.token) require_token_beyond_loopback(address_, std::nullopt);
}

void OptionalParts::start_missing(double now_s) {
  const auto start = [&](RetriedPart& part, const auto& work) {
    if (auto reported = part.attempt(now_s, work)) publish_(*std::move(reported));
  };
  if (setup_.recording.folder && !recorder_owner_) start(retries_.recorder, [&] { start_recorder(); });
  if (!server_) start(retries_.api, [&] { start_api(); });
  if (setup_.candidates.folder && setup_.map && !tiles_owner_) start(retries_.tiles, [&] { start_tiles(); });
}

void OptionalParts::close() {
  tiles_owner_.reset();
  server_.reset();
  if (recorder_owner_) recorder_owner_->close("stopped");
}

void OptionalParts::start_recorder() {
  RecorderOptions recorder;
  recorder.store.folder = *setup_.recording.folder;
  recorder.keep_pictures = setup_.recording.keep_pictures;
  SessionRecord session = session_record(setup_.airframe, clock_);
  if (setup_.map) add_start(session, *setup_.localization, *setup_.map);
  recorder_owner_ = std::make_unique<Recorder>(recorder, std::move(session),
                                               [this] { return static_cast<std::uint64_t>(clock_.unix_us()) * 1000; });
  recorder_ = recorder_owner_.get();
}

void OptionalParts::start_api() {
  ApiOptions api;
  api.now_s = [this] { return clock_.monotonic_s(); };
  api.token = token_digest(setup_.api.token);
  api.loopback = address_.loopback();
  if (!api.token) {
    std::string failure;
    api.hint_token = hint_token_digest(setup_.state / kHintToken, failure);
    if (!failure.empty()) publish_(PartReported{"token of the hints", failure});
  }
  if (!api_) {
    auto made = std::make_unique<Api>(board_, hints_, api);
    if (setup_.map) made->use_package(setup_.map->for_api());
    api_ = std::move(made);
  }
  server_ = std::make_unique<HttpServer>(*api_, address_);
}

void OptionalParts::start_tiles() {
  const LocalizerConfig config = setup_.map->config();
  const TileMakingSetup making{*setup_.candidates.folder,
                               setup_.candidates.tile_key.value_or(""),
                               CandidateFlight{.airframe = setup_.airframe.id,
                                               .flight = fmt::format("{:x}", clock_.unix_us()),
                                               .base_package = sha256_file(setup_.map->folder() / kManifestFile),
                                               .camera = setup_.airframe.camera.camera,
                                               .readout = setup_.airframe.camera.readout,
                                               .frame = setup_.map->frame(),
                                               .surface = config.surface,
                                               .zoom = setup_.map->package().mission().zoom.max},
                               static_cast<std::uint64_t>(setup_.candidates.budget_mb) * 1'000'000,
                               setup_.candidates.percent / 100.0,
                               setup_.candidates.frame_ms / 1000.0};
  TileMaking::Listener listener;
  listener.on_tile = [this](const TileKey& key, CandidateOutcome outcome) {
    if (Recorder* recorder = recorder_) {
      recorder->record(TileRecord{key, fmt::format("candidate.{}", name_of(outcome)), {}});
    }
  };
  listener.on_failure = [this](const std::string& reason) {
    if (auto reported = retries_.making.note(clock_.monotonic_s(), reason)) publish_(*std::move(reported));
  };
  tiles_owner_ = std::make_unique<TileMaking>(making, clock_, std::move(listener));
  tiles_ = tiles_owner_.get();
  if (setup_.root_version != 0) report_installed_package(making);
}

// It costs the ground a line in a list, and the flight nothing.
void OptionalParts::report_installed_package(const TileMakingSetup& making) {
  const Manifest& manifest = setup_.map->package().manifest();
  const UtcTime now{clock_.unix_us() / 1'000'000};
  try {
    write_installed_report({.airframe = setup_.airframe.id,
                            .reported_at = now,
                            .package = making.flight.base_package,
                            .series = manifest.series,
                            .sequence = manifest.sequence,
                            .root_version = setup_.root_version,
                            .verified_at = now,
                            .findings = codes_in(setup_.findings)},
                           PrivateKey::read(making.key), setup_.state, making.folder);
  } catch (const Error& error) {
    publish_(PartReported{"report of the flown package", error.what()});
  }
}

}  // namespace nadir
