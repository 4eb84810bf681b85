// Candidate tiles in flight: anchored frames become tiles on their own low-priority thread, which rests three
// times as long as it works (a share of 0.25). The caller never waits; a frame that arrives while another is processed
// replaces the pending one.
//
// A failure here (a full disk above all) costs tiles, never a position.
#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <thread>

#include "base/bytes.hpp"
#include "estimation/telemetry.hpp"
#include "ortho/candidate_maker.hpp"
#include "service/clock.hpp"
#include "service/mailbox.hpp"

namespace nadir {

struct TileMakingSetup {
  std::filesystem::path folder;  // of the candidates
  std::filesystem::path key;     // file with the airframe's tile key
  CandidateFlight flight;        // without its key, which is read from the file; without a surface the ground is flat
  std::uint64_t budget_bytes = 2'000'000'000;
  double share = 0.25;       // of one core's time, over a few frames
  double frame_limit_s = 0;  // for one frame, the whole of its tiles; 0: none
};

class TileMaking {
 public:
  struct Listener {  // on the maker's thread; at the end on that of the destructor
    std::function<void(const TileKey&, CandidateOutcome)> on_tile;
    std::function<void(const std::string&)> on_failure;         // of each frame; empty: it went well
    std::function<void(const FrameTiles&)> on_frame = nullptr;  // after each frame
  };

  // Throws Error for an invalid key or folder: before take-off.
  TileMaking(const TileMakingSetup& setup, const FlightClock& clock, Listener listener);
  ~TileMaking();  // finishes the current frame and the tiles that several frames complete; then closes the store
  TileMaking(const TileMaking&) = delete;
  TileMaking& operator=(const TileMaking&) = delete;

  // Both on the tracker's thread. Every frame is kept until it or a later one is anchored.
  void on_frame(std::uint64_t index, const Telemetry& telemetry, ByteView encoded);
  void on_anchor(std::uint64_t index, const FramePose& pose);

 private:
  struct KeptFrame {
    std::uint64_t index = 0;
    std::string name;
    double captured_s = 0;
    Bytes encoded;
  };
  struct Work {
    PosedFrame frame;
    Bytes encoded;
  };
  void make_tiles(const std::stop_token& stop);
  void make(const Work& work);

  const FlightClock& clock_;
  Listener listener_;
  double rest_;  // in units of the working time
  double frame_limit_s_;
  FlatGround flat_;
  PrivateKey key_;
  CandidateMaker maker_;
  CandidateStore store_;
  std::deque<KeptFrame> frames_;  // of the tracker's thread
  std::size_t kept_bytes_ = 0;
  LatestMailbox<Work> work_;
  std::jthread maker_thread_;  // last: it uses everything above
};

}  // namespace nadir
