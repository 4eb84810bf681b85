#include "flight/upkeep.hpp"

#include <algorithm>
#include <chrono>
#include <exception>
#include <utility>

#include "base/error.hpp"
#include "base/platform.hpp"

namespace nadir {
namespace {

constexpr std::chrono::milliseconds kUpkeepWait{500};

}  // namespace

Upkeep::Upkeep(UpkeepSetup setup, OptionalParts& parts, const FlightClock& clock, Publish publish)
    : clock_(clock),
      publish_(std::move(publish)),
      parts_(parts),
      state_(std::move(setup.state)),
      unsaved_{.flight = std::nullopt, .acceptance = std::move(setup.acceptance)},
      write_memory_(std::move(setup.write_memory)),
      package_{.can_be_opened = std::move(setup.can_be_opened)} {}

void Upkeep::start(AutopilotLink& link) {
  link_ = &link;
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

void Upkeep::run(const std::stop_token& stop) {
  begin_thread("upkeep", ThreadPriority::low);
  Cadence signing_time(kSavePeriod_s, clock_.monotonic_s()), health(kHealthPeriod_s, clock_.monotonic_s());
  while (!stop.stop_requested()) {
    if (Recorder* recorder = parts_.recorder(); recorder != nullptr && health.due(clock_.monotonic_s())) {
      recorder->record(HealthRecord{true, health_.measure(clock_.monotonic_s()), {}});
    }
    // Before it is written anew: what was wrong with the file of the last run.
    if (auto reported = retries_.signing.note(clock_.monotonic_s(), link_->signing_time_failure())) {
      publish_(*std::move(reported));
    }
    if (signing_time.due(clock_.monotonic_s())) link_->save_signing_state(StreamTimestamps::When::in_flight);
    if (auto flight = flights_.take_within(kUpkeepWait, stop)) unsaved_.flight = *std::move(flight);
    if (auto acceptance = acceptances_.try_take()) unsaved_.acceptance = *std::move(acceptance);
    if (!stop.stop_requested()) tend();
  }
}

void Upkeep::tend() {
  const double now_s = clock_.monotonic_s();
  const auto attempt = [&](RetriedPart& part, const auto& work) {
    if (auto reported = part.attempt(now_s, work)) publish_(*std::move(reported));
  };
  attempt(retries_.state, [&] { save_state(); });  // first: it makes the folder
  parts_.start_missing(now_s);
  if (write_memory_) {
    attempt(retries_.memory, [&] {
      write_memory_();
      write_memory_ = nullptr;
    });
  }
  if (package_.can_be_opened) ask_for_package(now_s);
}

// All of it, or an exception: what was not written stays for the next time.
void Upkeep::save_state() {
  if (!state_prepared_ || !retries_.state.works()) state_.prepare();
  state_prepared_ = true;
  if (unsaved_.acceptance) state_.save(*unsaved_.acceptance);
  unsaved_.acceptance.reset();
  if (!unsaved_.flight) return;
  if (auto failure = state_.save(*unsaved_.flight)) throw Error({.what = *std::move(failure)});
  unsaved_.flight.reset();
}

// The first time is a pause after the start, which has just tried.
void Upkeep::ask_for_package(double now_s) {
  PackageQuestion& package = package_;
  if (now_s < package.next_s) return;
  if (package.next_s > 0 && package.can_be_opened()) {
    package.can_be_opened = nullptr;
    publish_(PackageRestored{});
  }
  package.next_s = now_s + package.pause_s;
  package.pause_s = std::min(2 * package.pause_s, kLastRetry_s);
}

std::string Upkeep::finish() {
  thread_ = {};
  if (auto flight = flights_.try_take()) unsaved_.flight = *std::move(flight);
  if (auto acceptance = acceptances_.try_take()) unsaved_.acceptance = *std::move(acceptance);
  std::string failure;
  try {
    if (unsaved_.flight || unsaved_.acceptance) save_state();
    if (write_memory_) write_memory_();
  } catch (const std::exception& error) {
    failure = error.what();
  }
  if (link_ != nullptr) link_->save_signing_state(StreamTimestamps::When::clean_end);
  return failure;
}

}  // namespace nadir
