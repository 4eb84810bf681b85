// `nadir ortho`: what a flight saw, as signed candidate tiles and as a mosaic for people.
#include <fmt/format.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <tuple>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/progress.hpp"
#include "base/quantile.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "commands/ortho/compare_page.hpp"
#include "commands/scratch_folder.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/frame_image.hpp"
#include "imagery/mbtiles.hpp"
#include "ortho/candidate_maker.hpp"
#include "ortho/radiometric_balance.hpp"
#include "ortho/surface_model.hpp"
#include "ortho/tile_key_check.hpp"
#include "package_build/candidate_mosaic.hpp"
#include "replay/flight_request.hpp"
#include "token_keys/token_key.hpp"
#include "vision/camera_frame.hpp"
#include "vision/rolling_shutter.hpp"

namespace nadir {
namespace {

constexpr double kMargin_m = 20;               // around the flight's tiles on the page
constexpr double kUnixFrom_s = 1'000'000'000;  // a clock that counts from 1970 shows it

UtcMillis first_frame_time(const std::optional<std::string>& asked, const ReadyFlight& ready) {
  if (asked) {
    if (const auto time = parse_utc_millis(*asked)) return *time;
    if (const auto time = parse_utc(*asked)) return {time->unix_s * 1000};
    throw UsageError({.what = "--captured is not a time",
                      .expected = "a time like 2026-05-01T12:00:00Z or 2026-05-01T12:00:00.250Z",
                      .found = *asked});
  }
  if (ready.recorded && static_cast<double>(ready.recorded->first_input_ns) >= kUnixFrom_s * 1e9) {
    return {static_cast<std::int64_t>(ready.recorded->first_input_ns / 1'000'000)};
  }
  const double first_s = ready.flight.frames.front().time_s;
  if (first_s >= kUnixFrom_s) return {static_cast<std::int64_t>(first_s * 1000)};
  throw UsageError({.what = "capture time unknown",
                    .expected = "--captured TIME of the first frame, a recording, or telemetry in seconds since 1970",
                    .fix = "give --captured 2026-05-01T12:00:00Z"});
}

// The ground of all tiles, which are of one zoom.
PlaneBox ground_of(const MbtilesReader& tiles, const LocalFrame& frame) {
  auto range = tiles.database().prepare(
      "SELECT min(tile_column), max(tile_column), min(tile_row), max(tile_row), max(zoom_level) FROM tiles");
  range.step();
  const auto z = static_cast<std::uint8_t>(range.integer(4));
  const auto bounds = [&](int column, int row) {
    return bounds_of(TileKey::from_tms(z, static_cast<std::uint32_t>(range.integer(column)),
                                       static_cast<std::uint32_t>(range.integer(row))));
  };
  const LonLatBox south_west = bounds(0, 2), north_east = bounds(1, 3);
  const PlanePoint low = frame.plane_from_lonlat({south_west.west_deg, south_west.south_deg});
  const PlanePoint high = frame.plane_from_lonlat({north_east.east_deg, north_east.north_deg});
  return {low.east_m - kMargin_m, low.north_m - kMargin_m, high.east_m + kMargin_m, high.north_m + kMargin_m};
}

struct TilesSummary {
  std::uint64_t frames = 0, used = 0;  // used: frames that tiles were made of …
  std::uint64_t narrow = 0;            // … and those of them that cover no tile completely
  std::uint64_t pieced = 0;            // tiles from several frames that were stored
  std::uint64_t unfinished = 0;        // tiles that all frames together do not cover, or not verifiably
  std::array<std::uint64_t, kPartialTileOutcomes> pieces{};
  std::array<std::uint64_t, kOrthoRefusals> frames_refused{}, tiles_refused{};
  std::uint64_t added = 0, replaced = 0, worse = 0, no_room = 0;
  std::uint64_t tiles = 0, bytes = 0;  // in the store at the end
};

Bytes picture_bytes(const std::filesystem::path& path) {
  try {
    return read_file(path);
  } catch (const Error&) {
    return {};  // an image that was lost in flight; the maker rejects the frame
  }
}

void count_frame(const FrameTiles& made, TilesSummary& summary) {
  if (made.refusal) {
    ++summary.frames_refused[static_cast<std::size_t>(*made.refusal)];
    return;
  }
  ++summary.used;
  if (made.whole == 0) ++summary.narrow;
}

void count_tiles(const FrameTiles& made, TilesSummary& summary) {
  summary.pieced += made.mosaics_stored;
  for (std::size_t i = 0; i < made.partial_tiles.size(); ++i) {
    summary.pieces[i] += static_cast<std::uint64_t>(made.partial_tiles[i]);
  }
  for (std::size_t i = 0; i < made.refused.size(); ++i) {
    summary.tiles_refused[i] += static_cast<std::uint64_t>(made.refused[i]);
  }
  for (const auto& [key, fate] : made.stored) {
    switch (fate) {
      case CandidateOutcome::added: ++summary.added; break;
      case CandidateOutcome::replaced: ++summary.replaced; break;
      case CandidateOutcome::worse: ++summary.worse; break;
      case CandidateOutcome::no_room: ++summary.no_room; break;
    }
  }
}

template <typename Kind, std::size_t N>
std::string text_of(const std::array<std::uint64_t, N>& counted) {
  std::string text;
  for (std::size_t i = 0; i < N; ++i) {
    if (counted[i] == 0) continue;
    text += fmt::format("{}{} {}", text.empty() ? "" : ", ", counted[i], name_of(static_cast<Kind>(i)));
  }
  return text.empty() ? "none" : text;
}

template <typename Kind, std::size_t N>
nlohmann::json json_of(const std::array<std::uint64_t, N>& counted) {
  nlohmann::json counts = nlohmann::json::object();
  for (std::size_t i = 0; i < N; ++i) {
    if (counted[i] != 0) counts[std::string(name_of(static_cast<Kind>(i)))] = counted[i];
  }
  return counts;
}

// Candidate tiles from all frames of a flight. first: capture time of the first frame. frame_ms: maximum time for the
// tiles of one frame; 0: no limit. corrections: of the frames' levels; empty: they stay as they were exposed.
TilesSummary make_flight_tiles(CandidateMaker& maker, CandidateStore& store, const Flight& flight,
                               const std::vector<std::optional<FramePose>>& poses, UtcMillis first, int frame_ms,
                               const std::vector<RadiometricCorrection>& corrections, Progress& progress) {
  TilesSummary summary;
  summary.frames = flight.frames.size();
  progress.begin(corrections.empty() ? "tiles" : "tiles of the mosaic", flight.frames.size(), "frames");
  for (std::size_t i = 0; i < flight.frames.size(); ++i) {
    const Telemetry& telemetry = flight.frames[i];
    const double since_s = telemetry.time_s - flight.frames.front().time_s;
    PosedFrame seen{telemetry.frame, {first.unix_ms + std::llround(since_s * 1000)}, {}};
    if (poses[i]) seen.pose = *poses[i];
    if (!corrections.empty()) seen.correction = corrections[i];
    const auto until = std::chrono::steady_clock::now() + std::chrono::milliseconds(frame_ms);
    DeadlinePassed out_of_time;
    if (frame_ms > 0) out_of_time = [until] { return std::chrono::steady_clock::now() > until; };
    const Bytes picture = poses[i] ? picture_bytes(flight.image_path(i)) : Bytes();
    const FrameTiles made = maker.make(seen, picture, store, out_of_time);
    count_frame(made, summary);
    count_tiles(made, summary);
    progress.advance(1);
  }
  count_tiles(maker.finish(store), summary);
  progress.end();
  summary.unfinished = maker.unfinished();
  summary.tiles = store.tiles();
  summary.bytes = store.bytes();
  return summary;
}

// The pictures of a flight for what they say together, smaller than they are.
class FlightPictures {
 public:
  // camera: of the pictures at full size, with the lens that the poses belong to.
  FlightPictures(const Flight& flight, const std::vector<std::optional<FramePose>>& poses, const CameraModel& camera)
      : flight_(flight),
        poses_(poses),
        shrink_(decode_reduction(camera.width, camera.height)),
        camera_(camera.scaled(1.0 / shrink_)) {}

  const CameraModel& camera() const { return camera_; }

  // Empty for a frame without a pose, and for a damaged one, of which there are no tiles either.
  cv::Mat of(std::size_t frame, Colour colour) const {
    if (!poses_[frame]) return {};
    try {
      cv::Mat picture = read_frame_file(flight_.image_path(frame), colour, shrink_);
      if (picture.cols != camera_.width || picture.rows != camera_.height) return {};
      if (!flight_.camera.readout) return picture;
      const auto& [pose, motion] = std::tie(poses_[frame]->pose, poses_[frame]->motion);
      return without_rolling_shutter(picture, camera_, *flight_.camera.readout,
                                     {pose.attitude, pose.agl_m, motion.velocity_mps, motion.rate_rad_s});
    } catch (const Error&) {
      return {};
    }
  }

 private:
  const Flight& flight_;
  const std::vector<std::optional<FramePose>>& poses_;
  int shrink_;
  CameraModel camera_;
};

SurfaceModel surface_from(const FlightPictures& pictures, const std::vector<std::optional<FramePose>>& poses,
                          const GroundSurface& terrain, Progress& progress, SurfaceModelFigures& figures) {
  std::vector<std::optional<CameraPose>> over_terrain(poses.size());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (poses[i]) over_terrain[i] = poses[i]->pose;
  }
  return surface_from_frames(
      pictures.camera(), terrain, over_terrain, [&](std::size_t i) { return pictures.of(i, Colour::grey); }, progress,
      &figures);
}

std::vector<RadiometricCorrection> balanced(const FlightPictures& pictures,
                                            const std::vector<std::optional<FramePose>>& poses,
                                            const GroundSurface& surface, Progress& progress) {
  RadiometricBalance balance(surface);
  progress.begin("exposures", poses.size(), "frames");
  for (std::size_t i = 0; i < poses.size(); ++i, progress.advance(1)) {
    const cv::Mat picture = pictures.of(i, Colour::bgr);
    if (!picture.empty()) balance.add(static_cast<std::uint32_t>(i), picture, pictures.camera(), poses[i]->pose);
  }
  progress.end();
  return balance.solve(poses.size());
}

nlohmann::json json_from(const TilesSummary& s) {
  return {{"schema", "nadir.ortho-summary/1"},
          {"frames", s.frames},
          {"frames_used", s.used},
          {"frames_without_whole_tile", s.narrow},
          {"frames_refused", json_of<OrthoRefusal>(s.frames_refused)},
          {"tiles", s.tiles},
          {"tiles_refused", json_of<OrthoRefusal>(s.tiles_refused)},
          {"tiles_pieced", s.pieced},
          {"tiles_unfinished", s.unfinished},
          {"pieces", json_of<PartialTileOutcome>(s.pieces)},
          {"replaced", s.replaced},
          {"worse", s.worse},
          {"no_room", s.no_room},
          {"bytes", s.bytes}};
}

// Where most frames cover no whole tile, tiles are pieced together from frames or stay unfinished, and the result is
// patches: the zooms at which frames cover several tiles each. Nothing where the zoom is not to blame, or where finer
// tiles would be finer than the frames' own pixels.
std::optional<std::string> zoom_advice(const TilesSummary& summary, const CameraModel& camera,
                                       const std::vector<std::optional<FramePose>>& poses, const LocalFrame& frame,
                                       int zoom) {
  std::vector<double> heights_m;
  double lat_deg = 0;
  for (const auto& pose : poses) {
    if (!pose) continue;
    heights_m.push_back(pose->pose.agl_m);
    lat_deg = frame.lonlat_from_plane(pose->pose.position).lat_deg;
  }
  if (heights_m.empty() || 2 * summary.narrow <= summary.used) return std::nullopt;
  const double agl_m = quantile(heights_m, 0.5), gsd_m = gsd_at(camera, agl_m);
  const double shorter_m = gsd_m * std::min(camera.width, camera.height);
  const auto pixel_m = [&](int z) { return ground_resolution_m(z, lat_deg); };
  const auto useful = [&](int z) { return z <= kMaxZoom && pixel_m(z) >= gsd_m; };
  int better = zoom + 1;
  while (useful(better) && kTileSize * pixel_m(better) > shorter_m / 2) ++better;  // two tiles across at any offset
  if (!useful(better)) return std::nullopt;
  return fmt::format("most frames ({:.0f} m across) cover no whole tile ({:.0f} m at zoom {}): try --zoom {}{}",
                     shorter_m, kTileSize * pixel_m(zoom), zoom, better,
                     useful(better + 1) ? fmt::format(" or {}", better + 1) : "");
}

Figures figures_from(const TilesSummary& s) {
  return {{"frames", std::to_string(s.frames)},
          {"frames used", std::to_string(s.used)},
          {"frames rejected", text_of<OrthoRefusal>(s.frames_refused)},
          {"frames without a complete tile", std::to_string(s.narrow)},
          {"candidate tiles", fmt::format("{}, {:.1f} MB", s.tiles, static_cast<double>(s.bytes) / 1e6)},
          {"from several frames", fmt::format("{} stored, {} incomplete", count(s.pieced, "tile"), s.unfinished)},
          {"partial tiles", text_of<PartialTileOutcome>(s.pieces)},
          {"tiles rejected", text_of<OrthoRefusal>(s.tiles_refused)},
          {"duplicates", fmt::format("{} replaced, {} discarded", s.replaced, s.worse)},
          {"beyond the budget", std::to_string(s.no_room)}};
}

class OrthoCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "ortho"; }
  std::string_view summary() const override { return "make signed candidate tiles from a flight"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  FlightPoses poses_of(Context& context, const ReadyFlight& ready) const;

  FlightRequest request_{"nadir ortho"};
  std::filesystem::path key_, out_;
  std::optional<std::filesystem::path> estimates_;
  std::optional<std::string> flight_;
  std::optional<std::string> captured_at_;
  std::optional<std::filesystem::path> mosaic_;
  std::string format_ = "jpeg";
  int quality_ = 82;
  std::optional<int> zoom_;
  bool single_frame_ = false, as_exposed_ = false;
  int frame_ms_ = 0;
  std::int64_t budget_mb_ = 4096;
};

std::string_view OrthoCommand::details() const {
  return R"(The flight is replayed and smoothed. Every sharp frame that was matched to the map and whose
position is known to 5 m is orthorectified over the package's terrain onto the mission's finest
tiles. Each tile gets a sidecar that states how it was made, signed with the airframe's tile key; of
two tiles of one place the better one is kept. Tiles that no single frame covers are mosaicked from
several frames.

OUT is a folder with tiles.mbtiles; the package does not change. With --estimates the poses of a
replay are used instead of replaying again: the tiles are the same.

Exit codes: 0 success, even without any tile, 1 the package was rejected, 2 the job could not be
done.)";
}

std::string_view OrthoCommand::examples() const {
  return R"(nadir ortho --package package --trust root.json --frames flight/frames --telemetry flight/telemetry.csv --camera camera.yaml --key tile.key.pem --airframe mini-07 --captured 2026-05-01T12:00:00Z --out candidates
nadir ortho --estimates result/poses.json --package package --trust root.json --frames flight/frames --telemetry flight/telemetry.csv --camera camera.yaml --key tile.key.pem --airframe mini-07 --captured 2026-05-01T12:00:00Z --out candidates
nadir ortho --recorder recording --package package --trust root.json --key tile.key.pem --airframe mini-07 --mosaic mosaic.tif --out candidates)";
}

void OrthoCommand::setup(Options& options) {
  request_.declare(options, FlightRequest::Map::required);
  options.value("--key", key_, "KEY.pem", "private tile key of the airframe (file or pkcs11: URI)").required();
  options.value("--out", out_, "OUT", "folder to create").required();
  options.value("--estimates", estimates_, "FILE.json",
                "poses.json of a nadir replay of this flight, instead of replaying it");
  options.value("--flight", flight_, "ID", "id of the flight; default: derived from its telemetry");
  options.value("--captured", captured_at_, "TIME", "capture time of the first frame, if the flight does not state it")
      .formerly("--captured-at");
  options.value("--zoom", zoom_, "Z", "zoom of the tiles; default: the mission's finest").between(0, kMaxZoom);
  options.flag("--single-frame", single_frame_, "only tiles that a single frame covers completely");
  options.value("--format", format_, "FORMAT", "encoding of the tiles").one_of({"jpeg", "webp"});
  options.value("--quality", quality_, "N", "quality of the tiles").between(1, 100);
  options.value("--budget-mb", budget_mb_, "MB", "maximum size of all tiles").between(1, 1'000'000);
  options.value("--frame-ms", frame_ms_, "MS", "maximum time for the tiles of one frame, as in flight; 0: no limit")
      .between(0, 60'000);
  options.value("--mosaic", mosaic_, "FILE.tif", "also write the tiles as a COG, and FILE.html beside it");
  options
      .flag("--as-exposed", as_exposed_,
            "the mosaic shows the tiles as they are: over the package's terrain, exposures not balanced")
      .needs("--mosaic");
}

FlightPoses OrthoCommand::poses_of(Context& context, const ReadyFlight& ready) const {
  if (estimates_) return read_poses(*estimates_, request_.poses_subject(ready), ready.flight.frames);
  const Truth no_truth(ready.flight.frames.size());
  return {replay_flight(ready.flight, *ready.setup, no_truth, nullptr, context.progress).poses, std::nullopt};
}

int OrthoCommand::run(Context& context) {
  request_.check();
  if (estimates_ && request_.says_how()) {
    throw UsageError({.what = "nadir ortho --estimates does not replay the flight",
                      .fix = "omit --start, --odometry and --matcher: they belong to nadir replay"});
  }
  if (!request_.airframe()) {
    throw UsageError({.what = "--airframe is required", .expected = "the airframe whose tile key signs"});
  }
  const PrivateKey key = read_signing_key(key_);
  require_tile_key(*request_.trust(), *request_.airframe(), key.public_key());
  StagingDirectory staging(out_);
  const std::filesystem::path unpacked = staging.path() / "unpacked";
  std::filesystem::create_directory(unpacked);
  const auto ready = request_.open(context, unpacked);
  if (!ready->setup) return report_findings(context.out, context.json, ready->findings);
  const UtcMillis first = first_frame_time(captured_at_, *ready);
  const Flight& flight = ready->flight;
  const FlatGround flat;
  const GroundSurface* surface = ready->setup->surface != nullptr ? ready->setup->surface : &flat;
  const ImageFormat format = *parse_image_format(format_);
  const FlightPoses posed = poses_of(context, *ready);
  CandidateFlight candidates{.airframe = *request_.airframe(),
                             .flight = flight_.value_or(id_of(flight)),
                             .base_package = sha256_file(*request_.package() / "manifest.json"),
                             .camera = flight.camera.camera,
                             .readout = flight.camera.readout,
                             .lens = posed.lens,
                             .frame = ready->setup->frame,
                             .surface = surface,
                             .key = &key,
                             .zoom = zoom_.value_or(ready->package->mission().zoom.max),
                             .format = format,
                             .quality = quality_,
                             .merge_partial_tiles = !single_frame_};
  const CandidateStoreOptions storing{.format = format,
                                      .budget_bytes = static_cast<std::uint64_t>(budget_mb_) * 1'000'000};
  const auto make_tiles = [&](const std::filesystem::path& folder, const std::vector<std::optional<FramePose>>& poses,
                              const std::vector<RadiometricCorrection>& corrections) {
    CandidateMaker maker(candidates);
    CandidateStore store(folder, storing);
    TilesSummary made = make_flight_tiles(maker, store, flight, poses, first, frame_ms_, corrections, context.progress);
    store.close();
    return made;
  };
  const TilesSummary summary = make_tiles(staging.path(), posed.poses, {});
  // What people look at: the same tiles over the ground's own shape, without the steps between exposures. They are no
  // candidates, and are gone with the key that signs them.
  const ScratchFolder scratch("nadir-ortho");
  std::filesystem::path shown = staging.path();
  SurfaceModelFigures fit;  // of the frames' orthophotos to each other
  if (mosaic_ && summary.tiles > 0 && !as_exposed_) {
    const CameraModel& nominal = flight.camera.camera;
    const FlightPictures pictures(flight, posed.poses, posed.lens ? posed.lens->applied_to(nominal) : nominal);
    const SurfaceModel shape = surface_from(pictures, posed.poses, *surface, context.progress, fit);
    std::vector<std::optional<FramePose>> over_shape = posed.poses;
    for (auto& pose : over_shape) {
      if (pose) pose->pose = shape.over_surface(pose->pose);
    }
    const PrivateKey passing_key = PrivateKey::generate();
    candidates.key = &passing_key;
    candidates.surface = &shape;
    candidates.limits.max_slope = std::numeric_limits<double>::infinity();  // roofs and woods
    const auto corrections = balanced(pictures, over_shape, shape, context.progress);
    if (make_tiles(scratch.path(), over_shape, corrections).tiles > 0) shown = scratch.path();
  }
  std::filesystem::remove_all(unpacked);

  nlohmann::json document = json_from(summary);
  Figures figures = figures_from(summary);
  const int zoom = zoom_.value_or(ready->package->mission().zoom.max);
  if (const auto advice = zoom_advice(summary, flight.camera.camera, posed.poses, ready->setup->frame, zoom)) {
    document["advice"] = *advice;
    if (!context.quiet) context.err << "note: " << *advice << '\n';
  }
  if (fit.measured > 0) {
    figures.emplace_back("frames fit in the mosaic",
                         fmt::format("to {:.2f} m (median of {} in {} of frames)", fit.along_px * fit.pixel_m,
                                     count(fit.measured, "place"), count(fit.pairs, "pair")));
  }
  if (mosaic_ && summary.tiles > 0) {
    const CandidateMosaic mosaic = write_candidate_mosaic(shown, *mosaic_, context.progress);
    const MbtilesReader tiles(shown / kCandidateFile);
    const LocalFrame& frame = ready->setup->frame;
    const ComparePage page{
        .title = "Orthophoto of the flight",
        .subtitle = fmt::format("{} · flight {} · map package {}", *request_.airframe(),
                                flight_.value_or(id_of(flight)), ready->package->manifest().mission_id),
        .headline = {{std::to_string(summary.tiles), "candidate tiles"},
                     {fmt::format("{} / {}", summary.used, summary.frames), "frames used"},
                     {fmt::format("{:.1f} MB", static_cast<double>(summary.bytes) / 1e6), "stored"}},
        .figures = figures};
    const std::filesystem::path page_file = std::filesystem::path(*mosaic_).replace_extension(".html");
    write_file_atomic(page_file, compare_page(page, ready->package->imagery(), tiles, frame, ground_of(tiles, frame)));
    document["mosaic"] = {{"file", mosaic_->string()},
                          {"page", page_file.string()},
                          {"zoom", mosaic.zoom},
                          {"width", mosaic.width},
                          {"height", mosaic.height}};
    if (fit.measured > 0) document["mosaic"]["fit_m"] = fit.along_px * fit.pixel_m;
    figures.emplace_back("mosaic", fmt::format("{}, {} x {} pixels, zoom {}", mosaic_->string(), mosaic.width,
                                               mosaic.height, mosaic.zoom));
    figures.emplace_back("page", page_file.string());
  }
  staging.commit();
  if (context.json) {
    print_json(context.out, document);
  } else {
    print_figures(context.out, figures);
  }
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_ortho() { return std::make_unique<OrthoCommand>(); }

}  // namespace nadir
