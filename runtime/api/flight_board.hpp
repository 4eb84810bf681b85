// Where the flight's thread puts its latest FlightView and any number of readers look at it.
//
// publish() never waits for a reader, however many there are and whatever they do: it is one atomic exchange. Readers
// wait for each other alone, for the moment that it takes to copy a pointer.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>

#include "api/flight_view.hpp"
#include "api/mailbox.hpp"

namespace nadir {

class FlightBoard {
 public:
  // From one thread. Numbers the view.
  void publish(FlightView view);

  // From any thread. Before the first publish(): a view of a service that boots.
  std::shared_ptr<const FlightView> snapshot() const;

 private:
  std::uint64_t versions_ = 0;
  mutable Mailbox<FlightView> newest_;
  mutable std::mutex readers_;
  mutable std::shared_ptr<const FlightView> seen_ = std::make_shared<const FlightView>();
};

}  // namespace nadir
