#include "recorder/segments.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>

#include "base/error.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

// Far beyond what a recorder ever writes, and far from where the number would wrap.
constexpr std::uint32_t kMaxNumber = 1'000'000'000;

constexpr std::array kExpendable{Stream::thumbnails, Stream::pictures, Stream::flight};  // in this order

std::optional<Segment> parse(const fs::path& path) {
  const std::string name = path.filename().string();
  Segment segment{.path = path};
  const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), segment.number);
  if (error != std::errc() || segment.number == 0 || segment.number > kMaxNumber) return std::nullopt;  // not ours
  const std::string_view rest(end, static_cast<std::size_t>(name.data() + name.size() - end));
  if (!rest.starts_with('.') || !rest.ends_with(".mcap") || rest.size() < 6) return std::nullopt;
  const auto stream = parse_stream(rest.substr(1, rest.size() - 6));
  if (!stream) return std::nullopt;
  segment.stream = *stream;
  return segment;
}

}  // namespace

fs::path segment_path(const fs::path& folder, std::uint32_t number, Stream stream) {
  return folder / fmt::format("{:06}.{}.mcap", number, name_of(stream));
}

std::vector<Segment> segments_in(const fs::path& folder) {
  std::vector<Segment> segments;
  std::error_code error;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    std::optional<Segment> segment = parse(at->path());
    if (!segment || !at->is_regular_file()) continue;
    std::error_code gone;
    segment->bytes = at->file_size(gone);
    if (!gone) segments.push_back(std::move(*segment));
  }
  if (error) throw Error({.what = "cannot read the folder", .where = folder, .found = error.message()});
  std::sort(segments.begin(), segments.end(), [](const Segment& a, const Segment& b) {
    return std::tie(a.number, a.stream) < std::tie(b.number, b.stream);
  });
  return segments;
}

std::vector<Segment>::const_iterator most_expendable(const std::vector<Segment>& segments, Stream up_to) {
  for (const Stream stream : kExpendable) {
    const auto found = std::find_if(segments.begin(), segments.end(),
                                    [&](const Segment& segment) { return segment.stream == stream; });
    if (found != segments.end()) return found;
    if (stream == up_to) break;
  }
  return segments.end();
}

SegmentFile::SegmentFile(std::filesystem::path path, bool sync) : path_(std::move(path)), sync_(sync) {
  fd_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
  if (fd_ < 0) error_ = errno;
}

SegmentFile::~SegmentFile() {
  if (fd_ >= 0) ::close(fd_);
}

bool SegmentFile::sync() {
  if (::fsync(fd_) == 0) return true;
  error_ = errno;
  return false;
}

bool SegmentFile::append(ByteView bytes) {
  if (fd_ < 0) return false;
  std::uint64_t at = size_;
  while (!bytes.empty()) {
    const ssize_t written = ::pwrite(fd_, bytes.data(), bytes.size(), static_cast<off_t>(at));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) {
      error_ = written < 0 ? errno : ENOSPC;
      // Truncating needs no space. Should it fail all the same, the next write overwrites the incomplete one.
      static_cast<void>(::ftruncate(fd_, static_cast<off_t>(size_)) == 0);
      return false;
    }
    at += static_cast<std::uint64_t>(written);
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
  if (sync_ && ::fdatasync(fd_) != 0) {
    // Some file systems report only now that there is no space.
    error_ = errno;
    static_cast<void>(::ftruncate(fd_, static_cast<off_t>(size_)) == 0);
    return false;
  }
  size_ = at;
  return true;
}

}  // namespace nadir
