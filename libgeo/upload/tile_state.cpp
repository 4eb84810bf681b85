#include "upload/tile_state.hpp"

namespace nadir {

std::string_view name_of(TileState state) {
  switch (state) {
    case TileState::staged: return "STAGED";
    case TileState::sealed: return "SEALED";
    case TileState::announced: return "ANNOUNCED";
    case TileState::sending: return "SENDING";
    case TileState::waiting: return "WAITING";
    case TileState::sent: return "SENT";
    case TileState::parked: return "PARKED";
    case TileState::accepted: return "ACCEPTED";
    case TileState::rejected: return "REJECTED";
    case TileState::duplicate: return "DUPLICATE";
    case TileState::refused: return "REFUSED";
    case TileState::damaged: return "DAMAGED";
  }
  return {};
}

std::optional<TileState> parse_tile_state(std::string_view name) {
  for (const TileState state : kTileStates) {
    if (name_of(state) == name) return state;
  }
  return std::nullopt;
}

}  // namespace nadir
