#include "api/flight_board.hpp"

#include <utility>

namespace nadir {

void FlightBoard::publish(FlightView view) {
  view.version = ++versions_;
  newest_.put(std::move(view));
}

std::shared_ptr<const FlightView> FlightBoard::snapshot() const {
  const std::lock_guard lock(readers_);
  if (std::unique_ptr<FlightView> newer = newest_.take()) seen_ = std::move(newer);
  return seen_;
}

}  // namespace nadir
