// Candidate tiles in flight: frames that the map has confirmed become tiles on a thread of its own, which comes last
// when the computer is busy and rests three times as long as it works (a share of 0.25). Who hands frames in never
// waits; a frame that comes while another is worked on takes the place of the one that waits.
//
// Whatever goes wrong here (a full disk above all) is told once and costs tiles, never a position.
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
#include "service/latest_mailbox.hpp"

namespace nadir {

struct TileMakingSetup {
  std::filesystem::path folder;  // of the candidates
  std::filesystem::path key;     // file with the airframe's tile key
  CandidateFlight flight;        // its key is that of the file; without a surface the ground is flat
  std::uint64_t budget_bytes = 2'000'000'000;
  double share = 0.25;       // of one core's time, over a few frames
  double frame_limit_s = 0;  // for one frame, the whole of its tiles; 0: none
};

class TileMaking {
 public:
  struct Listener {  // on the maker's thread; at the end on the one that ends it
    std::function<void(const TileKey&, CandidateOutcome)> tile;
    std::function<void(const std::string&)> trouble;         // each one once
    std::function<void(const FrameTiles&)> frame = nullptr;  // after each frame
  };

  // Throws Error for a key or a folder that is wrong: that must be right before take-off.
  TileMaking(const TileMakingSetup& setup, const FlightClock& clock, Listener listener);
  ~TileMaking();  // finishes the frame at hand and what is whole of several; the store then ends in order
  TileMaking(const TileMaking&) = delete;
  TileMaking& operator=(const TileMaking&) = delete;

  // Both on the localizer's thread. Every picture, kept until the map has said something about it or a later one.
  void seen(std::uint64_t index, const Telemetry& told, ByteView encoded);
  void anchored(std::uint64_t index, const FramePose& pose);

 private:
  struct Picture {
    std::uint64_t index = 0;
    std::string name;
    double taken_s = 0;
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
  double rest_;  // times the work
  double frame_limit_s_;
  FlatGround flat_;
  PrivateKey key_;
  CandidateMaker maker_;
  CandidateStore store_;
  std::string last_trouble_;

  std::deque<Picture> pictures_;  // the localizer's thread alone
  std::size_t picture_bytes_ = 0;
  LatestMailbox<Work> work_;
  std::jthread maker_thread_;  // last: it uses everything above
};

}  // namespace nadir
