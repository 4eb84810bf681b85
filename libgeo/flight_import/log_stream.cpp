#include "flight_import/log_stream.hpp"

#include <algorithm>
#include <utility>

namespace nadir {

LogStream::LogStream(InputFile file) : file_(std::move(file)), name_(file_->path().string()), size_(file_->size()) {}

LogStream::LogStream(ByteView bytes, std::string name) : bytes_(bytes), name_(std::move(name)), size_(bytes.size()) {}

ByteView LogStream::peek(std::size_t count) {
  count = std::min<std::uint64_t>({count, kMaxPeek, size_ - position_});
  if (!file_) return bytes_.subspan(position_, count);
  if (position_ < window_at_ || position_ + count > window_at_ + window_.size()) {
    window_.resize(std::min<std::uint64_t>(2 * kMaxPeek, size_ - position_));
    window_at_ = position_;
    if (!file_->read_at(position_, window_)) {  // it was cut off meanwhile
      window_.clear();
      size_ = position_;
      return {};
    }
  }
  return ByteView(window_).subspan(position_ - window_at_, count);
}

void LogStream::skip(std::uint64_t count) { position_ += std::min(count, size_ - position_); }

void LogStream::seek(std::uint64_t position) { position_ = std::min(position, size_); }

}  // namespace nadir
