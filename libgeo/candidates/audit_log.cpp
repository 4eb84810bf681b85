#include "candidates/audit_log.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/json.hpp"
#include "candidates/file_lock.hpp"

namespace nadir {

namespace fs = std::filesystem;

namespace {

constexpr std::size_t kLongestAuditText = 400;
constexpr off_t kAuditTail = 1 << 16;
constexpr std::size_t kMostCallers = 4096;
// For others' lines, which take microseconds each; and where lines are missing already.
constexpr std::chrono::milliseconds kLockPatience{1000}, kBriefPatience{20};

fs::path audit_file(const fs::path& folder, int age) {
  return folder / (age == 0 ? std::string("audit.jsonl") : fmt::format("audit.{}.jsonl", age));
}

std::string shortened(const std::string& text) { return text.substr(0, kLongestAuditText); }

std::string line_of(const AuditEntry& entry, std::int64_t number, UtcTime at, std::int64_t more) {
  nlohmann::ordered_json line{
      {"n", number}, {"at", to_rfc3339(at)}, {"act", shortened(entry.act)}, {"result", shortened(entry.result)}};
  const auto add = [&line](const char* name, const std::string& text) {
    if (!text.empty()) line[name] = shortened(text);
  };
  add("token", entry.token);
  add("client", entry.client);
  add("key", entry.key);
  add("subject", entry.subject);
  add("detail", entry.detail);
  if (more > 0) line["more"] = more;
  return line.dump(-1, ' ', true, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

// The number of the last whole line, 0 when there is none.
std::int64_t last_number(std::string_view text) {
  while (!text.empty()) {
    const std::size_t end = text.rfind('\n');
    if (end == std::string_view::npos) return 0;
    text = text.substr(0, end);
    const std::size_t begin = text.rfind('\n');
    const std::string_view line = text.substr(begin == std::string_view::npos ? 0 : begin + 1);
    try {
      const nlohmann::json document = parse_json(line, "the audit log", {.max_depth = 2, .allow_floats = false});
      const JsonReader in(document, {.name = "the audit log", .what = "not a line of the audit log"});
      return in.integer("n", 1, std::int64_t{1} << 53);
    } catch (const Error&) {  // torn, or not ours
    }
    if (begin == std::string_view::npos) return 0;
    text = text.substr(0, begin + 1);
  }
  return 0;
}

}  // namespace

AuditLog::AuditLog(fs::path folder, const Clock& clock, AuditLimits limits)
    : folder_(std::move(folder)), clock_(clock), limits_(limits) {
  try {
    open();
  } catch (const std::exception& error) {  // tried again with every line
    why_unwritten_ = error.what();
  }
}

AuditLog::~AuditLog() {
  const std::lock_guard lock(mutex_);
  write_suppressed(std::numeric_limits<std::int64_t>::max());
  close_gap();
  if (fd_ >= 0) ::close(fd_);
}

void AuditLog::open() {
  std::error_code code;
  fs::create_directories(folder_, code);
  const fs::path path = audit_file(folder_, 0);
  fd_ = ::open(path.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC | O_NOFOLLOW, 0600);
  struct stat facts {};
  if (fd_ < 0 || ::fstat(fd_, &facts) != 0 || !S_ISREG(facts.st_mode)) {
    const int error = fd_ < 0 ? errno : EINVAL;
    if (fd_ >= 0) ::close(fd_);
    fd_ = -1;
    throw Error({.what = "cannot write the audit log",
                 .where = path,
                 .expected = "a file that this service may append to",
                 .found = system_error_text(error),
                 .fix = "make room, or give the service's user the right to write it; without it nothing is recorded"});
  }
  read_end();
  const fs::path before = audit_file(folder_, 1);
  if (size_ == 0 && fs::exists(before)) {  // between a rotation and its first line
    next_ = std::max(next_, last_number(read_text_file(before, limits_.file_bytes)) + 1);
  }
}

// Where the file ends, and which number comes next.
void AuditLog::read_end() {
  struct stat facts {};
  if (::fstat(fd_, &facts) != 0 || static_cast<std::uint64_t>(facts.st_size) == size_) return;
  size_ = static_cast<std::uint64_t>(facts.st_size);
  std::string tail(static_cast<std::size_t>(std::min<off_t>(facts.st_size, kAuditTail)), '\0');
  const ssize_t got = ::pread(fd_, tail.data(), tail.size(), facts.st_size - static_cast<off_t>(tail.size()));
  tail.resize(got > 0 ? static_cast<std::size_t>(got) : 0);
  next_ = std::max(next_, last_number(tail) + 1);
  // A line that a killed process, or a full disk, left torn must not swallow the next one.
  if (!tail.empty() && tail.back() != '\n' && ::write(fd_, "\n", 1) == 1) ++size_;
}

// The file that lines go to now, which another process may have begun.
void AuditLog::lock_newest(std::optional<FileLock>& lock) {
  for (;;) {
    if (fd_ < 0) open();
    lock.emplace(fd_, unwritten_ == 0 ? kLockPatience : kBriefPatience, "the audit log", audit_file(folder_, 0));
    struct stat ours {
    }, named{};
    const bool newest = ::fstat(fd_, &ours) == 0 && ::stat(audit_file(folder_, 0).c_str(), &named) == 0 &&
                        ours.st_ino == named.st_ino && ours.st_dev == named.st_dev;
    if (newest) return read_end();
    lock.reset();
    ::close(fd_);
    fd_ = -1, size_ = 0;
  }
}

void AuditLog::rotate() {
  std::error_code ignored;
  for (int age = limits_.files - 1; age > 0; --age) {
    fs::rename(audit_file(folder_, age - 1), audit_file(folder_, age), ignored);
  }
  ::close(fd_);
  fd_ = -1;
  size_ = 0;
  open();
}

void AuditLog::write(const AuditEntry& entry, std::int64_t more) {
  if (!close_gap() || !append(entry, more)) ++unwritten_;
}

// Once the log can be written again, it says itself how many lines are missing from it. False: it cannot yet.
bool AuditLog::close_gap() {
  if (unwritten_ == 0) return true;
  const AuditEntry gap{.act = "audit.gap",
                       .result = "lines missing",
                       .subject = fmt::format("lines {}", unwritten_),
                       .detail = why_unwritten_};
  if (!append(gap, 0)) return false;
  unwritten_ = 0;
  return true;
}

// Other processes write as well (`nadir-candidates work`): each line under a lock, after what is there.
bool AuditLog::append(const AuditEntry& entry, std::int64_t more) {
  try {
    std::optional<FileLock> lock;
    lock_newest(lock);
    std::string line = line_of(entry, next_, clock_.now(), more);
    if (size_ > 0 && size_ + line.size() > limits_.file_bytes) {
      rotate();
      lock_newest(lock);
      line = line_of(entry, next_, clock_.now(), more);
    }
    const ssize_t written = ::write(fd_, line.data(), line.size());
    if (written != static_cast<ssize_t>(line.size())) {
      const int error = written < 0 ? errno : ENOSPC;
      if (written > 0 && ::ftruncate(fd_, static_cast<off_t>(size_)) != 0) size_ += static_cast<std::uint64_t>(written);
      throw Error({.what = "cannot write the audit log",
                   .where = audit_file(folder_, 0),
                   .found = system_error_text(error),
                   .fix = error == ENOSPC ? "make room on this disk" : "check the disk"});
    }
    size_ += line.size();
    ++next_;
    why_unwritten_.clear();
    return true;
  } catch (const std::exception& error) {
    why_unwritten_ = error.what();
    return false;
  }
}

void AuditLog::record(const AuditEntry& entry) {
  const std::lock_guard lock(mutex_);
  const std::int64_t minute = clock_.now().unix_s / 60;
  write_suppressed(minute);
  if (minutes_.size() >= kMostCallers) minutes_.clear();
  Minute& current = minutes_[entry.act + '\n' + entry.result + '\n' + entry.token];
  if (current.acts++ == 0) current.number = minute;
  current.last = entry;
  if (current.acts <= limits_.equal_per_minute) write(entry, 0);
}

void AuditLog::flush() {
  const std::lock_guard lock(mutex_);
  write_suppressed(clock_.now().unix_s / 60);
  close_gap();
}

// Of minutes other than this one.
void AuditLog::write_suppressed(std::int64_t minute) {
  for (auto at = minutes_.begin(); at != minutes_.end();) {
    if (at->second.number == minute) {
      ++at;
      continue;
    }
    const std::int64_t more = at->second.acts - limits_.equal_per_minute;
    if (more > 0) write(at->second.last, more);
    at = minutes_.erase(at);
  }
}

std::string AuditLog::fault() {
  const std::lock_guard lock(mutex_);
  return why_unwritten_.empty() ? std::string() : "lines are missing from the audit log: " + why_unwritten_;
}

}  // namespace nadir
