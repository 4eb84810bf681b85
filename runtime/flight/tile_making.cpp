#include "flight/tile_making.hpp"

#include <chrono>
#include <cmath>
#include <utility>

#include "base/error.hpp"
#include "base/platform.hpp"

namespace nadir {
namespace {

constexpr std::size_t kMaxKeptBytes = 48 << 20;  // of frames that wait for their anchor
constexpr std::size_t kMaxKeptFrames = 100;
constexpr std::chrono::milliseconds kWait{500};

CandidateFlight completed(CandidateFlight flight, const GroundSurface& flat, const PrivateKey& key) {
  flight.key = &key;
  if (flight.surface == nullptr) flight.surface = &flat;
  return flight;
}

}  // namespace

TileMaking::TileMaking(const TileMakingSetup& setup, const FlightClock& clock, Listener listener)
    : clock_(clock),
      listener_(std::move(listener)),
      rest_(1 / setup.share - 1),
      frame_limit_s_(setup.frame_limit_s),
      key_(PrivateKey::read(setup.key)),
      maker_(completed(setup.flight, flat_, key_)),
      store_(setup.folder, {.budget_bytes = setup.budget_bytes}),
      maker_thread_([this](const std::stop_token& stop) { make_tiles(stop); }) {}

TileMaking::~TileMaking() {
  maker_thread_.request_stop();
  work_.close();
  maker_thread_.join();
  try {
    for (const auto& [key, fate] : maker_.finish(store_).stored) listener_.on_tile(key, fate);
    store_.close();
  } catch (const std::exception&) {
    // A full disk: the stored tiles are there, and the missing end marker says that the store was not closed.
  }
}

void TileMaking::on_frame(std::uint64_t index, const Telemetry& telemetry, ByteView encoded) {
  frames_.push_back({index, telemetry.frame, telemetry.time_s, Bytes(encoded.begin(), encoded.end())});
  kept_bytes_ += encoded.size();
  while (kept_bytes_ > kMaxKeptBytes || frames_.size() > kMaxKeptFrames) {
    kept_bytes_ -= frames_.front().encoded.size();
    frames_.pop_front();
  }
}

void TileMaking::on_anchor(std::uint64_t index, const FramePose& pose) {
  while (!frames_.empty() && frames_.front().index <= index) {
    KeptFrame frame = std::move(frames_.front());
    frames_.pop_front();
    kept_bytes_ -= frame.encoded.size();
    if (frame.index != index) continue;
    const double ago_s = clock_.monotonic_s() - frame.captured_s;
    const std::int64_t captured_ms = clock_.unix_us() / 1000 - std::llround(ago_s * 1000);
    work_.put({{frame.name, {captured_ms}, pose}, std::move(frame.encoded)});
  }
}

void TileMaking::make_tiles(const std::stop_token& stop) {
  begin_thread("tiles", ThreadPriority::low);
  while (!stop.stop_requested()) {
    const auto work = work_.take_within(kWait, stop);
    if (!work) continue;
    const double before_s = clock_.monotonic_s();
    make(*work);
    const double now_s = clock_.monotonic_s();
    clock_.wait_until(now_s + rest_ * (now_s - before_s), stop);
  }
}

void TileMaking::make(const Work& work) {
  try {
    const double until_s = clock_.monotonic_s() + frame_limit_s_;
    DeadlinePassed out_of_time;
    if (frame_limit_s_ > 0) out_of_time = [this, until_s] { return clock_.monotonic_s() > until_s; };
    const FrameTiles made = maker_.make(work.frame, work.encoded, store_, out_of_time);
    for (const auto& [key, fate] : made.stored) listener_.on_tile(key, fate);
    if (listener_.on_frame) listener_.on_frame(made);
    listener_.on_failure({});
  } catch (const std::exception& error) {
    listener_.on_failure(error.what());
  }
}

}  // namespace nadir
