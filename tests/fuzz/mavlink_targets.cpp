// What arrives over the autopilot's link: bytes into frames, frames into messages.
#include <algorithm>
#include <vector>

#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"
#include "mavlink/messages.hpp"

namespace nadir::fuzz {
namespace {

std::vector<Bytes> frames_of(ByteView bytes, std::size_t piece) {
  FrameReader reader;
  std::vector<Bytes> frames;
  const auto drain = [&] {
    while (const auto frame = reader.next()) {
      static_cast<void>(decode(*frame));
      frames.push_back(frame->bytes);
    }
  };
  for (std::size_t at = 0; at < bytes.size(); at += piece) {
    reader.add(bytes.subspan(at, std::min(piece, bytes.size() - at)));
    drain();
  }
  reader.finish();
  drain();
  std::size_t used = 0;
  for (const Bytes& frame : frames) used += frame.size();
  require(used + reader.counts().skipped_bytes == bytes.size(), "bytes that are neither frames nor skipped");
  require(frames.size() == reader.counts().frames, "frames that are not counted");
  return frames;
}

}  // namespace

void mavlink(std::string_view bytes) {
  const std::vector<Bytes> frames = frames_of(as_bytes(bytes), bytes.size() + 1);
  frames_of(as_bytes(bytes), 1);
  // What is sound alone is sound in a row.
  Bytes joined;
  for (const Bytes& frame : frames) joined.insert(joined.end(), frame.begin(), frame.end());
  require(frames_of(joined, joined.size() + 1) == frames, "sound frames are not found again");
}

}  // namespace nadir::fuzz
