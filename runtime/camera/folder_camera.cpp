#include "camera/folder_camera.hpp"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/inotify.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/platform.hpp"
#include "imagery/frame_image.hpp"

namespace nadir {

namespace fs = std::filesystem;
using namespace std::string_view_literals;

struct FolderChanges {
  std::vector<std::string> finished;  // names, in order of completion
  bool overflowed = false;            // events were lost: scan the folder
  bool gone = false;                  // the folder was deleted, moved away or unmounted
};

// Files that were completed since the last call: closed after writing, or moved in. inotify(7) as values.
class FolderWatch {
 public:
  // Throws Error when the folder cannot be watched.
  explicit FolderWatch(const std::filesystem::path& folder);
  ~FolderWatch();
  FolderWatch(const FolderWatch&) = delete;
  FolderWatch& operator=(const FolderWatch&) = delete;

  // Waits for changes, at most this long or until stop.
  FolderChanges wait(std::chrono::milliseconds at_most, const std::stop_token& stop);

 private:
  int events_ = -1;
  int wake_ = -1;
};

namespace {

constexpr std::uint32_t kGone = IN_DELETE_SELF | IN_MOVE_SELF | IN_UNMOUNT | IN_IGNORED;

const char* advice_for(int error_number) {
  switch (error_number) {
    case ENOSPC: return "raise fs.inotify.max_user_watches";
    case EMFILE: return "raise fs.inotify.max_user_instances, or the limit of open files";
    case EACCES: return "let the service's user read the folder";
    default: return "create the folder, or correct --camera";
  }
}

[[noreturn]] void fail(const std::filesystem::path& folder) {
  const int error_number = errno;
  throw Error({.what = "cannot watch the camera's folder",
               .where = folder,
               .found = system_error_text(error_number),
               .fix = advice_for(error_number)});
}

void add(FolderChanges& changes, const inotify_event& event) {
  if ((event.mask & IN_Q_OVERFLOW) != 0) changes.overflowed = true;
  if ((event.mask & kGone) != 0) changes.gone = true;
  if ((event.mask & (IN_CLOSE_WRITE | IN_MOVED_TO)) != 0 && event.len > 0) changes.finished.emplace_back(event.name);
}

bool ends_with_marker(ByteView bytes, std::string_view marker) {
  constexpr std::size_t kPadding = 4096;  // some cameras pad files to whole blocks
  const std::string_view text = as_text(bytes);
  const std::string_view tail = text.substr(text.size() - std::min(text.size(), kPadding + marker.size()));
  const std::size_t at = tail.rfind(marker);
  if (at == std::string_view::npos) return false;
  return tail.find_first_not_of("\0\xff"sv, at + marker.size()) == std::string_view::npos;
}

bool is_complete_webp(ByteView bytes) {
  std::uint64_t size = 0;
  for (std::size_t i = 0; i < 4; ++i) size |= std::uint64_t{bytes[4 + i]} << (8 * i);
  return bytes.size() >= size + 8;
}

constexpr std::uint64_t kMaxImageSize = std::uint64_t{1} << 28;

// When the file last changed, in our monotonic seconds; nullopt: it is gone.
std::optional<double> changed_s(const fs::path& file, const FlightClock& clock) {
  struct stat info {};
  if (::stat(file.c_str(), &info) != 0) return std::nullopt;
  const double ago_s = 1e-6 * static_cast<double>(clock.unix_us()) - static_cast<double>(info.st_ctim.tv_sec) -
                       1e-9 * static_cast<double>(info.st_ctim.tv_nsec);
  return clock.monotonic_s() - ago_s;
}

CameraReading failure(std::string detail) { return {CameraStatus::failure, {}, std::move(detail)}; }

}  // namespace

FolderWatch::FolderWatch(const std::filesystem::path& folder)
    : events_(::inotify_init1(IN_CLOEXEC | IN_NONBLOCK)), wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  const std::uint32_t mask = IN_CLOSE_WRITE | IN_MOVED_TO | IN_DELETE_SELF | IN_MOVE_SELF | IN_ONLYDIR;
  if (events_ >= 0 && wake_ >= 0 && ::inotify_add_watch(events_, folder.c_str(), mask) >= 0) return;
  const int error_number = errno;
  if (events_ >= 0) ::close(events_);
  if (wake_ >= 0) ::close(wake_);
  errno = error_number;
  fail(folder);
}

FolderWatch::~FolderWatch() {
  ::close(events_);
  ::close(wake_);
}

FolderChanges FolderWatch::wait(std::chrono::milliseconds at_most, const std::stop_token& stop) {
  const std::stop_callback wake_up(stop, [this] {
    const std::uint64_t one = 1;
    [[maybe_unused]] const ssize_t written = ::write(wake_, &one, sizeof one);
  });
  std::array<pollfd, 2> waits{{{events_, POLLIN, 0}, {wake_, POLLIN, 0}}};
  const auto longest = std::chrono::milliseconds(std::chrono::minutes(1));
  const int timeout_ms = static_cast<int>(std::clamp(at_most, std::chrono::milliseconds(0), longest).count());
  ::poll(waits.data(), waits.size(), stop.stop_requested() ? 0 : timeout_ms);
  std::uint64_t woken = 0;
  [[maybe_unused]] const ssize_t drained = ::read(wake_, &woken, sizeof woken);

  FolderChanges changes;
  alignas(inotify_event) std::array<char, 65'536> buffer;
  for (;;) {
    const ssize_t size = ::read(events_, buffer.data(), buffer.size());
    if (size <= 0) return changes;
    for (std::size_t at = 0; at + sizeof(inotify_event) <= static_cast<std::size_t>(size);) {
      const auto& event = *reinterpret_cast<const inotify_event*>(buffer.data() + at);
      add(changes, event);
      at += sizeof(inotify_event) + event.len;
    }
  }
}

bool is_complete_image(ByteView bytes) {
  if (bytes.size() < 12) return false;
  const std::string_view text = as_text(bytes);
  if (text.starts_with("\xff\xd8\xff"sv)) return ends_with_marker(bytes, "\xff\xd9"sv);
  if (text.starts_with("\x89PNG\r\n\x1a\n"sv)) return ends_with_marker(bytes, "IEND\xae\x42\x60\x82"sv);
  if (is_tiff(bytes)) return is_complete_tiff(bytes);
  if (text.starts_with("RIFF"sv) && text.substr(8).starts_with("WEBP"sv)) return is_complete_webp(bytes);
  return false;
}

bool has_image_name(const std::filesystem::path& name) {
  const std::string file = name.filename();
  std::string extension = name.extension();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  constexpr std::array kKnown{".jpg"sv, ".jpeg"sv, ".png"sv, ".webp"sv, ".tif"sv, ".tiff"sv};
  return !file.starts_with('.') && std::find(kKnown.begin(), kKnown.end(), extension) != kKnown.end();
}

FolderCamera::FolderCamera(fs::path folder, const FlightClock& clock, Backlog backlog)
    : folder_(std::move(folder)), clock_(clock), backlog_(backlog) {}

FolderCamera::~FolderCamera() = default;

std::optional<FolderCamera::Version> FolderCamera::version_of(const fs::path& file) {
  struct stat info {};
  if (::stat(file.c_str(), &info) != 0 || !S_ISREG(info.st_mode)) return std::nullopt;  // a pipe would block
  return Version{info.st_mtim.tv_sec * std::int64_t{1'000'000'000} + info.st_mtim.tv_nsec,
                 static_cast<std::uint64_t>(info.st_size), info.st_ino, file.filename()};
}

// The watch starts before the scan: an image completed during the scan appears twice rather than never.
std::optional<CameraReading> FolderCamera::open() {
  try {
    watch_ = std::make_unique<FolderWatch>(folder_);
  } catch (const Error& error) {
    return failure(error.what());
  }
  pending_.clear();
  if (backlog_ != Backlog::skip) scan_folder(true);
  if (backlog_ == Backlog::newest && pending_.size() > 1) pending_.erase(pending_.begin(), std::prev(pending_.end()));
  return std::nullopt;
}

// all: every image; else only those that are not older than the last delivered one.
void FolderCamera::scan_folder(bool all) {
  const Noticed now = notice();
  std::error_code error;
  for (fs::directory_iterator file(folder_, error), end; !error && file != end; file.increment(error)) {
    if (!has_image_name(file->path())) continue;
    const auto version = version_of(file->path());
    if (!version || (!all && version->modified_ns < last_.modified_ns)) continue;
    pending_.emplace(version->name, now);
  }
}

// nullopt: nothing to deliver or report.
std::optional<CameraReading> FolderCamera::take(const std::string& name, const Noticed& noticed) {
  const fs::path file = folder_ / name;
  const auto before = version_of(file);
  if (!before || *before == last_) return std::nullopt;
  try {
    const double arrived_s = std::clamp(changed_s(file, clock_).value_or(noticed.time_s),
                                        noticed.time_s - noticed.delayed_s, noticed.time_s);
    CameraFrame frame{name, arrived_s, read_file(file, kMaxImageSize), std::nullopt};
    if (version_of(file) != before) return std::nullopt;  // being rewritten: its writer will close it
    if (!is_complete_image(frame.bytes)) {
      return CameraReading{CameraStatus::bad_frame, {}, name + " is truncated or not an image"};
    }
    last_ = *before;
    return CameraReading{CameraStatus::frame, std::move(frame), {}};
  } catch (const Error& error) {
    if (!fs::exists(file)) return std::nullopt;
    return CameraReading{CameraStatus::bad_frame, {}, error.what()};
  }
}

// Since it last looked, this thread was ready for so long without a processor.
FolderCamera::Noticed FolderCamera::notice() {
  const double delayed_s = thread_delayed_s();
  return {clock_.monotonic_s(), std::max(0.0, delayed_s - std::exchange(delayed_s_, delayed_s))};
}

CameraReading FolderCamera::next(std::chrono::milliseconds at_most, std::stop_token stop) {
  if (!watch_) {
    if (auto failed = open()) {
      clock_.wait_until(clock_.monotonic_s() + 1e-3 * static_cast<double>(at_most.count()), stop);
      return std::move(*failed);
    }
  }
  FolderChanges changes = watch_->wait(pending_.empty() ? at_most : std::chrono::milliseconds(0), stop);
  if (changes.gone) {
    watch_.reset();
    pending_.clear();
    return failure("the folder is gone");
  }
  const Noticed now = notice();
  for (const std::string& name : changes.finished) {
    if (has_image_name(name)) pending_.insert_or_assign(name, now);
  }
  if (changes.overflowed) scan_folder(false);
  while (!pending_.empty() && !stop.stop_requested()) {
    const auto first = pending_.extract(pending_.begin());
    if (auto reading = take(first.key(), first.mapped())) return std::move(*reading);
  }
  return {};
}

}  // namespace nadir
