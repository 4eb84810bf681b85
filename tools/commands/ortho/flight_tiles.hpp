// Candidate tiles from all frames of a flight, and their counts.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>

#include "base/progress.hpp"
#include "cli/output.hpp"
#include "ortho/candidate_maker.hpp"
#include "replay/flight_request.hpp"

namespace nadir {

struct TilesSummary {
  std::uint64_t frames = 0, used = 0;  // used: frames that tiles were made of …
  std::uint64_t narrow = 0;            // … and those of them that cover no tile completely
  std::uint64_t pieced = 0;            // tiles from several frames that were stored
  std::uint64_t unfinished = 0;  // tiles that all frames together do not cover, or not verifiably
  std::array<std::uint64_t, kPartialTileOutcomes> pieces{};
  std::array<std::uint64_t, kOrthoRefusals> frames_refused{}, tiles_refused{};
  std::uint64_t added = 0, replaced = 0, worse = 0, no_room = 0;
  std::uint64_t tiles = 0, bytes = 0;  // in the store at the end
};

// first: capture time of the first frame. frame_ms: maximum time for the tiles of one frame; 0: no limit.
TilesSummary make_flight_tiles(CandidateMaker& maker, CandidateStore& store, const Flight& flight,
                               const std::vector<std::optional<FramePose>>& poses, UtcMillis first, int frame_ms,
                               Progress& progress);

nlohmann::json json_from(const TilesSummary& summary);
Figures figures_from(const TilesSummary& summary);

}  // namespace nadir
