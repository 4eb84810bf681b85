#include "camera/folder_camera.hpp"

#include <sys/stat.h>

#include <utility>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "camera/whole_picture.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

constexpr std::uint64_t kMaxPictureSize = std::uint64_t{1} << 28;

CameraReading trouble(std::string detail) { return {CameraNews::trouble, {}, std::move(detail)}; }

}  // namespace

FolderCamera::FolderCamera(fs::path folder, const FlightClock& clock, Backlog backlog)
    : folder_(std::move(folder)), clock_(clock), backlog_(backlog) {}

std::optional<FolderCamera::Version> FolderCamera::version_of(const fs::path& file) {
  struct stat info {};
  if (::stat(file.c_str(), &info) != 0 || !S_ISREG(info.st_mode)) return std::nullopt;  // a pipe would hold us up
  return Version{info.st_mtim.tv_sec * std::int64_t{1'000'000'000} + info.st_mtim.tv_nsec,
                 static_cast<std::uint64_t>(info.st_size), info.st_ino, file.filename()};
}

// The watch comes first: what is finished while the folder is read shows up twice rather than never.
std::optional<CameraReading> FolderCamera::open() {
  try {
    watch_ = std::make_unique<FolderWatch>(folder_);
  } catch (const Error& error) {
    return trouble(error.what());
  }
  waiting_.clear();
  if (backlog_ != Backlog::skip) look_at_folder(true);
  if (backlog_ == Backlog::newest && waiting_.size() > 1) waiting_.erase(waiting_.begin(), std::prev(waiting_.end()));
  return std::nullopt;
}

// all: whatever is there; else only what is younger than the last one that was handed out.
void FolderCamera::look_at_folder(bool all) {
  const double now_s = clock_.monotonic_s();
  std::error_code error;
  for (fs::directory_iterator file(folder_, error), end; !error && file != end; file.increment(error)) {
    if (!has_picture_name(file->path())) continue;
    const auto version = version_of(file->path());
    if (!version || (!all && version->modified_ns < last_.modified_ns)) continue;
    waiting_.emplace(version->name, now_s);
  }
}

// nullopt: there is nothing to say about it.
std::optional<CameraReading> FolderCamera::take(const std::string& name, double time_s) {
  const fs::path file = folder_ / name;
  const auto before = version_of(file);
  if (!before || *before == last_) return std::nullopt;
  try {
    CameraFrame frame{name, time_s, read_file(file, kMaxPictureSize), std::nullopt};
    if (version_of(file) != before) return std::nullopt;  // being written again: its writer will close it
    if (!is_whole_picture(frame.bytes)) return trouble(name + " is cut off or no picture");
    last_ = *before;
    return CameraReading{CameraNews::frame, std::move(frame), {}};
  } catch (const Error& error) {
    if (!fs::exists(file)) return std::nullopt;
    return trouble(error.what());
  }
}

CameraReading FolderCamera::next(std::chrono::milliseconds at_most, std::stop_token stop) {
  if (!watch_) {
    if (auto failed = open()) {
      clock_.wait_until(clock_.monotonic_s() + 1e-3 * static_cast<double>(at_most.count()), stop);
      return std::move(*failed);
    }
  }
  FolderNews news = watch_->wait(waiting_.empty() ? at_most : std::chrono::milliseconds(0), stop);
  if (news.gone) {
    watch_.reset();
    waiting_.clear();
    return trouble("the folder is gone");
  }
  const double now_s = clock_.monotonic_s();
  for (const std::string& name : news.finished) {
    if (has_picture_name(name)) waiting_.insert_or_assign(name, now_s);
  }
  if (news.overflowed) look_at_folder(false);
  while (!waiting_.empty() && !stop.stop_requested()) {
    const auto first = waiting_.extract(waiting_.begin());
    if (auto reading = take(first.key(), first.mapped())) return std::move(*reading);
  }
  return {};
}

}  // namespace nadir
