// What waits for the disk when the flight ends: the upkeep thread over a real folder and a real link, with a clock that
// stands still, so that nothing that failed is ever due again.
#include "flight/upkeep.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <limits>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <vector>

#include "base/files.hpp"
#include "flight/link_peer.hpp"
#include "support/manual_clock.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using testing::HasSubstr;

class UpkeepAtTheEnd : public ::testing::Test {
 protected:
  UpkeepAtTheEnd() {
    OptionalPartsSetup parts;
    parts.api.address = "127.0.0.1:0";
    parts.state = setup_.state = folder_ / "state";
    parts_ = std::make_unique<OptionalParts>(std::move(parts), clock_, publisher());
  }
  ~UpkeepAtTheEnd() override {
    upkeep_.reset();
    parts_->close();
  }

  OptionalParts::Publish publisher() {
    return [this](const OnboardEvent& event) {
      const auto* reported = std::get_if<PartReported>(&event);
      if (reported == nullptr) return;
      const std::scoped_lock lock(mutex_);
      reported_.push_back(reported->part + (reported->failure.empty() ? " works" : " failed"));
    };
  }
  std::vector<std::string> reported() const {
    const std::scoped_lock lock(mutex_);
    return reported_;
  }

  void begin() {
    upkeep_ = std::make_unique<Upkeep>(setup_, *parts_, clock_, publisher());
    upkeep_->tend();
    AutopilotLinkSetup link;
    link.transport = make_transport(parse_endpoint(peer_.endpoint()));
    link_ = std::make_unique<AutopilotLink>(
        std::move(link), clock_, watch_,
        AutopilotLink::Listener{[](const MessageTimes&, const ReceivedMessage&) {}, {}, {}});
    link_->start();
    upkeep_->start(*link_);
  }
  std::string finish() {
    link_->stop();
    return upkeep_->finish();
  }

  SavedFlight flight(ServiceState state) const {
    SavedFlight flight;
    flight.boot_id = clock_.boot_id();
    flight.saved_monotonic_s = clock_.monotonic_s();
    flight.saved_unix_us = clock_.unix_us();
    flight.state = state;
    return flight;
  }
  static AcceptanceRecord acceptance(bool airborne) {
    AcceptedPackage package;
    package.folder = "/data/a";
    package.series = "a";
    AcceptanceRecord record = accepted_next(std::nullopt, package, "boot-1");
    record.airborne = airborne;
    return record;
  }
  StateDirectory state() const { return StateDirectory(setup_.state); }

  const test::TemporaryFolder folder_;
  ManualClock clock_;
  ThreadWatch watch_{clock_};
  test::LinkPeer peer_;
  UpkeepSetup setup_;
  mutable std::mutex mutex_;
  std::vector<std::string> reported_;
  std::unique_ptr<OptionalParts> parts_;
  std::unique_ptr<AutopilotLink> link_;
  std::unique_ptr<Upkeep> upkeep_;
};

// The disk was full, and has room again before the next attempt is due.
TEST_F(UpkeepAtTheEnd, WhatWaitsIsSavedAlthoughItIsNotDue) {
  folder_.write("state", "a file in its place");
  setup_.acceptance = acceptance(true);
  int written = 0;
  setup_.write_memory = [&] {
    if (!std::filesystem::is_directory(setup_.state)) throw std::runtime_error("no folder");
    ++written;
  };
  begin();
  std::filesystem::remove(setup_.state);
  upkeep_->save(flight(ServiceState::normal));
  EXPECT_EQ(finish(), "");
  EXPECT_EQ(reported(), (std::vector<std::string>{"state directory failed", "token of the hints failed",
                                                  "memory of packages failed"}));
  ASSERT_TRUE(state().load().flight) << state().load().rejection;
  EXPECT_EQ(state().load().flight->state, ServiceState::normal);
  EXPECT_EQ(state().load_acceptance().record, acceptance(true));
  EXPECT_EQ(written, 1);
}

// The landing may be the last thing that is known of a flight.
TEST_F(UpkeepAtTheEnd, TheLatestOfSeveralIsSaved) {
  begin();
  upkeep_->save(flight(ServiceState::degraded));
  upkeep_->save(acceptance(true));
  upkeep_->save(flight(ServiceState::no_fix));
  upkeep_->save(acceptance(false));
  EXPECT_EQ(finish(), "");
  EXPECT_TRUE(reported().empty());
  ASSERT_TRUE(state().load().flight) << state().load().rejection;
  EXPECT_EQ(state().load().flight->state, ServiceState::no_fix);
  EXPECT_EQ(state().load_acceptance().record, acceptance(false));
}

TEST_F(UpkeepAtTheEnd, WhatCannotBeSavedIsSaid) {
  folder_.write("state", "a file in its place");
  begin();
  upkeep_->save(flight(ServiceState::normal));
  EXPECT_THAT(finish(), HasSubstr("cannot use the state directory"));
  EXPECT_EQ(read_text_file(setup_.state), "a file in its place");
}

TEST_F(UpkeepAtTheEnd, AnEstimateThatCannotBeReadAgainLeavesTheLastOne) {
  begin();
  state().save(flight(ServiceState::normal));
  SavedFlight broken = flight(ServiceState::degraded);
  broken.estimate = SavedEstimate{.place = {std::numeric_limits<double>::quiet_NaN(), 0}};
  upkeep_->save(broken);
  upkeep_->save(acceptance(true));
  EXPECT_THAT(finish(), HasSubstr("cannot save this state of the flight"));
  ASSERT_TRUE(state().load().flight) << state().load().rejection;
  EXPECT_EQ(state().load().flight->state, ServiceState::normal);
  EXPECT_EQ(state().load_acceptance().record, acceptance(true));
}

}  // namespace
}  // namespace nadir
