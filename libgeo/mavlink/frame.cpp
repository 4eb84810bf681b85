#include "mavlink/frame.hpp"

#include <ardupilotmega/mavlink.h>

#include <algorithm>

namespace nadir {
namespace {

bool is_start(std::uint8_t byte) { return byte == MAVLINK_STX || byte == MAVLINK_STX_MAVLINK1; }

// Validates bytes that look like one frame with the generated parser.
std::optional<mavlink_message_t> parsed(ByteView bytes) {
  mavlink_message_t working{};
  mavlink_message_t message{};
  mavlink_status_t status{};
  std::uint8_t verdict = MAVLINK_FRAMING_INCOMPLETE;
  for (const std::uint8_t byte : bytes) {
    verdict = mavlink_frame_char_buffer(&working, &status, byte, &message, nullptr);
  }
  if (verdict != MAVLINK_FRAMING_OK) return std::nullopt;
  return message;
}

}  // namespace

void FrameReader::add(ByteView bytes) {
  buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(at_));
  suspect_end_ -= std::min(suspect_end_, at_);
  at_ = 0;
  finished_ = false;
  buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
}

void FrameReader::skip(std::size_t count) {
  at_ += count;
  counts_.skipped_bytes += count;
}

// Length of the frame at at_ according to its header; 0: the header is incomplete.
std::size_t FrameReader::candidate_size() const {
  const std::size_t left = buffer_.size() - at_;
  if (left < 3) return 0;
  const std::uint8_t* p = buffer_.data() + at_;
  if (p[0] == MAVLINK_STX_MAVLINK1) return MAVLINK_CORE_HEADER_MAVLINK1_LEN + 1U + p[1] + MAVLINK_NUM_CHECKSUM_BYTES;
  const std::size_t signature = (p[2] & MAVLINK_IFLAG_SIGNED) != 0 ? kSignatureSize : 0;
  return MAVLINK_NUM_HEADER_BYTES + p[1] + MAVLINK_NUM_CHECKSUM_BYTES + signature;
}

// Rejects the candidate of `size` bytes at at_; the search resumes inside it. When another frame starts at its end, the
// length was right: nothing inside it is waited for or counted.
void FrameReader::reject(std::uint64_t& count, std::size_t size) {
  if (!inside_suspect()) {
    ++count;
    const std::size_t after = at_ + size;
    if (after == buffer_.size() || (after < buffer_.size() && is_start(buffer_[after]))) suspect_end_ = after;
  }
  skip(1);
}

std::optional<MavlinkFrame> FrameReader::next() {
  while (true) {
    const auto from = buffer_.begin() + static_cast<std::ptrdiff_t>(at_);
    skip(static_cast<std::size_t>(std::find_if(from, buffer_.end(), is_start) - from));
    if (at_ == buffer_.size()) return std::nullopt;

    const std::uint8_t* p = buffer_.data() + at_;
    const std::size_t left = buffer_.size() - at_;
    const bool second = p[0] == MAVLINK_STX;
    const std::size_t size = candidate_size();
    if (second && left >= 3 && (p[2] & ~MAVLINK_IFLAG_MASK) != 0) {
      reject(counts_.incompatible, size);
      continue;
    }
    if (size == 0 || left < size) {
      if (!finished_ && !inside_suspect()) return std::nullopt;
      reject(counts_.truncated, size);
      continue;
    }
    const std::uint32_t id = second ? p[7] | (std::uint32_t{p[8]} << 8) | (std::uint32_t{p[9]} << 16) : p[5];
    if (mavlink_get_msg_entry(id) == nullptr) {
      reject(counts_.unknown, size);
      continue;
    }
    const auto message = parsed({p, size});
    if (!message) {
      reject(counts_.bad_crc, size);
      continue;
    }
    ++counts_.frames;
    MavlinkFrame frame{.bytes = Bytes(p, p + size),
                       .version = second ? 2 : 1,
                       .message_id = id,
                       .source = {message->sysid, message->compid},
                       .sequence = message->seq,
                       .has_signature = (message->incompat_flags & MAVLINK_IFLAG_SIGNED) != 0};
    at_ += size;
    return frame;
  }
}

void mark_signed(Bytes& frame) {
  frame[2] |= MAVLINK_IFLAG_SIGNED;
  const std::uint32_t id = frame[7] | (std::uint32_t{frame[8]} << 8) | (std::uint32_t{frame[9]} << 16);
  const std::size_t end = frame.size() - MAVLINK_NUM_CHECKSUM_BYTES;
  std::uint16_t crc = crc_calculate(frame.data() + 1, static_cast<std::uint16_t>(end - 1));
  crc_accumulate(mavlink_get_msg_entry(id)->crc_extra, &crc);
  frame[end] = static_cast<std::uint8_t>(crc & 0xFF);
  frame[end + 1] = static_cast<std::uint8_t>(crc >> 8);
}

}  // namespace nadir
