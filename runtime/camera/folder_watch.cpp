#include "camera/folder_watch.hpp"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/inotify.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>

#include "base/error.hpp"

namespace nadir {
namespace {

constexpr std::uint32_t kGone = IN_DELETE_SELF | IN_MOVE_SELF | IN_UNMOUNT | IN_IGNORED;

[[noreturn]] void fail(const std::filesystem::path& folder) {
  const int error_number = errno;
  throw Error({.what = "cannot watch the camera's folder",
               .where = folder,
               .found = system_error_text(error_number),
               .fix = error_number == ENOSPC || error_number == EMFILE ? "raise fs.inotify.max_user_watches"
                                                                       : "create the folder, or name the right one"});
}

void add(FolderNews& news, const inotify_event& event) {
  if ((event.mask & IN_Q_OVERFLOW) != 0) news.overflowed = true;
  if ((event.mask & kGone) != 0) news.gone = true;
  if ((event.mask & (IN_CLOSE_WRITE | IN_MOVED_TO)) != 0 && event.len > 0) news.finished.emplace_back(event.name);
}

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

FolderNews FolderWatch::wait(std::chrono::milliseconds at_most, const std::stop_token& stop) {
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

  FolderNews news;
  alignas(inotify_event) std::array<char, 65'536> buffer;
  for (;;) {
    const ssize_t size = ::read(events_, buffer.data(), buffer.size());
    if (size <= 0) return news;
    for (std::size_t at = 0; at + sizeof(inotify_event) <= static_cast<std::size_t>(size);) {
      const auto& event = *reinterpret_cast<const inotify_event*>(buffer.data() + at);
      add(news, event);
      at += sizeof(inotify_event) + event.len;
    }
  }
}

}  // namespace nadir
