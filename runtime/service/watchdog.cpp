#include "service/watchdog.hpp"

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <cstring>

#include "base/error.hpp"
#include "base/number_text.hpp"

namespace nadir {
namespace {

std::optional<std::string> variable(const char* name) {
  const char* value = std::getenv(name);  // NOLINT(concurrency-mt-unsafe): before there are threads
  return value != nullptr && *value != '\0' ? std::optional<std::string>(value) : std::nullopt;
}

// A line break in a status would begin another assignment.
std::string one_line(std::string_view text) {
  std::string line(text);
  std::replace(line.begin(), line.end(), '\n', ' ');
  return line;
}

}  // namespace

std::string LateThread::text() const {
  return fmt::format("{} silent for {:.1f} s (at most {} s)", name, silent_s, limit_s);
}

ThreadWatch::Beat ThreadWatch::watch(std::string name, double limit_s) {
  auto watched = std::make_shared<Watched>(std::move(name), limit_s, clock_.monotonic_s());
  const std::scoped_lock lock(mutex_);
  watched_.push_back(watched);
  return {std::move(watched), clock_};
}

std::vector<LateThread> ThreadWatch::late() const {
  const std::scoped_lock lock(mutex_);
  watched_.remove_if([](const auto& watched) { return watched->ended.load(); });
  const double now_s = clock_.monotonic_s();
  std::vector<LateThread> late;
  for (const auto& watched : watched_) {
    const double silent_s = now_s - watched->last_s.load();
    if (silent_s > watched->limit_s) late.push_back({watched->name, silent_s, watched->limit_s});
  }
  return late;
}

ServiceManager::ServiceManager(std::optional<std::string> socket) {
  if (!socket) return;
  address_ = std::move(*socket);
  const bool named = address_.size() > 1 && (address_.front() == '/' || address_.front() == '@');
  if (!named || address_.size() >= sizeof(sockaddr_un::sun_path)) {
    throw Error(
        {.what = "invalid socket of a service manager",
         .where = "NOTIFY_SOCKET",
         .expected = fmt::format("an absolute path or @name of at most {} bytes", sizeof(sockaddr_un::sun_path) - 1),
         .found = address_,
         .fix = "start nadird through systemd, or unset NOTIFY_SOCKET"});
  }
  if (address_.front() == '@') address_.front() = '\0';
  fd_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd_ < 0) {
    throw Error({.what = "cannot create a socket for the service manager",
                 .where = "NOTIFY_SOCKET",
                 .found = system_error_text(errno),
                 .fix = "raise the limit of open files, and allow AF_UNIX in the unit"});
  }
}

ServiceManager::~ServiceManager() {
  if (fd_ >= 0) ::close(fd_);
}

bool ServiceManager::send(const std::string& message) const {
  if (fd_ < 0) return false;
  sockaddr_un to{};
  to.sun_family = AF_UNIX;
  std::memcpy(to.sun_path, address_.data(), address_.size());
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + address_.size());
  const ssize_t sent =
      ::sendto(fd_, message.data(), message.size(), MSG_NOSIGNAL, reinterpret_cast<const sockaddr*>(&to), size);
  return sent == static_cast<ssize_t>(message.size());
}

bool ServiceManager::ready(std::string_view status) const { return send("READY=1\nSTATUS=" + one_line(status)); }
bool ServiceManager::status(std::string_view status) const { return send("STATUS=" + one_line(status)); }
bool ServiceManager::alive() const { return send("WATCHDOG=1"); }
bool ServiceManager::stopping(std::string_view status) const { return send("STOPPING=1\nSTATUS=" + one_line(status)); }

ServiceEnvironment read_service_environment() {
  ServiceEnvironment environment{variable("NOTIFY_SOCKET"), std::nullopt};
  const auto interval_us = whole_number<std::uint64_t>(variable("WATCHDOG_USEC").value_or(""));
  const auto pid_text = variable("WATCHDOG_PID");
  const bool ours = !pid_text || whole_number<pid_t>(*pid_text) == ::getpid();
  if (interval_us && *interval_us > 0 && ours)
    environment.watchdog_interval_s = 1e-6 * static_cast<double>(*interval_us);
  return environment;
}

std::optional<std::string> Watchdog::tick(double now_s) {
  std::string names, texts;
  for (const LateThread& thread : threads_.late()) {
    names += (names.empty() ? "" : ", ") + thread.name;
    texts += (texts.empty() ? "" : ", ") + thread.text();
  }
  if (names.empty() && enabled_ && cadence_.due(now_s)) manager_.alive();
  if (names == late_names_) return std::nullopt;
  late_names_ = std::move(names);
  if (!texts.empty()) manager_.status("hangs: " + texts);
  return texts;
}

}  // namespace nadir
