// Pictures into a folder that somebody watches: each appears whole, under a name that carries its time and sorts by it,
// frame_<microseconds since 1970, UTC, 16 digits>.jpg.
#pragma once

#include <deque>
#include <filesystem>
#include <optional>

#include "simulation/frame_sink.hpp"

namespace nadir {

class FrameFolder final : public FrameSink {
 public:
  // Makes the folder when it is missing; what lies in it stays. keep: so many of its own pictures at most, the oldest
  // go first.
  explicit FrameFolder(std::filesystem::path folder, std::optional<int> keep = {});

  void put(ByteView jpeg, std::int64_t unix_us) override;

 private:
  std::filesystem::path folder_;
  std::optional<int> keep_;
  std::deque<std::filesystem::path> written_;
};

}  // namespace nadir
