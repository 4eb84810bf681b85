// Where a candidate tile stands on its way from the outbox to a verdict (docs/sync.md has the picture).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

namespace nadir {

enum class TileState : std::uint8_t {
  staged,     // in the outbox
  sealed,     // in a signed batch
  announced,  // the service lacks it
  sending,    // its pack is on the wire
  waiting,    // its pack was interrupted, the next attempt will come
  sent,       // the service has its bytes; the verdict is awaited
  parked,     // no further attempt until the operator says so
  accepted,   // final
  rejected,   // final, with a code
  duplicate,  // final: this very candidate was accepted before
  refused,    // final, with a code: the service did not even want it
  damaged     // final: what the outbox holds of it is not what was staged
};

inline constexpr std::array kTileStates{TileState::staged,    TileState::sealed,   TileState::announced,
                                        TileState::sending,   TileState::waiting,  TileState::sent,
                                        TileState::parked,    TileState::accepted, TileState::rejected,
                                        TileState::duplicate, TileState::refused,  TileState::damaged};

std::string_view name_of(TileState state);  // "STAGED", as the outbox holds it
std::optional<TileState> parse_tile_state(std::string_view name);
constexpr bool is_final(TileState state) { return state >= TileState::accepted; }

}  // namespace nadir
