#include "commands/ortho/flight_tiles.hpp"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace {

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

}  // namespace

TilesSummary make_flight_tiles(CandidateMaker& maker, CandidateStore& store, const Flight& flight,
                               const std::vector<std::optional<FramePose>>& poses, UtcMillis first, int frame_ms,
                               Progress& progress) {
  TilesSummary summary;
  summary.frames = flight.frames.size();
  progress.begin("tiles", flight.frames.size(), "frames");
  for (std::size_t i = 0; i < flight.frames.size(); ++i) {
    const Telemetry& telemetry = flight.frames[i];
    const double since_s = telemetry.time_s - flight.frames.front().time_s;
    PosedFrame seen{telemetry.frame, {first.unix_ms + std::llround(since_s * 1000)}, {}};
    if (poses[i]) seen.pose = *poses[i];
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

}  // namespace nadir
