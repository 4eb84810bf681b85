#include "simulation/frame_sink.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <ostream>
#include <utility>

#include "base/error.hpp"
#include "base/input_file.hpp"

namespace nadir {
namespace {

constexpr unsigned kFrameMode = 0644;  // the camera's folder is often another user's

[[noreturn]] void fail(const std::filesystem::path& path, int error_number) {
  throw Error({.what = "the frame cannot be written",
               .where = path.string(),
               .expected = "a writable folder with free space",
               .found = system_error_text(error_number),
               .fix = "free space, or choose another --out; --keep N limits the size of the folder"});
}

// 0, or the error of the first call that fails.
int write_all(int file, ByteView bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(file, bytes.data(), bytes.size());
    if (written < 0 && errno != EINTR) return errno;
    if (written > 0) bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
  return ::fchmod(file, kFrameMode) == 0 ? 0 : errno;
}

}  // namespace

FrameFolder::FrameFolder(std::filesystem::path folder, std::optional<int> keep)
    : folder_(std::move(folder)), keep_(keep) {
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  if (error || !std::filesystem::is_directory(folder_)) {
    throw Error({.what = "the folder cannot be created",
                 .where = folder_.string(),
                 .found = error ? error.message() : "not a folder",
                 .fix = "choose another --out"});
  }
}

void FrameFolder::put(ByteView jpeg, std::int64_t unix_us) {
  const std::filesystem::path path = folder_ / fmt::format("frame_{:016}.jpg", std::max<std::int64_t>(0, unix_us));
  // Not a PendingFile: that waits for the disk, twice, which would cost frames, and a frame is needed for seconds.
  std::string hidden = folder_ / ".frame.XXXXXX";
  const FileDescriptor file(::mkostemp(hidden.data(), O_CLOEXEC));
  if (!file) fail(path, errno);
  int error_number = write_all(file.get(), jpeg);
  if (error_number == 0 && ::rename(hidden.c_str(), path.c_str()) != 0) error_number = errno;
  if (error_number != 0) {
    ::unlink(hidden.c_str());
    fail(path, error_number);
  }
  if (!keep_) return;
  std::error_code ignored;
  // A clock that was set back may give a name twice: it counts once, as the newest.
  std::erase(written_, path);
  written_.push_back(path);
  while (std::ssize(written_) > *keep_) {
    std::filesystem::remove(written_.front(), ignored);  // the reader may have removed it already
    written_.pop_front();
  }
}

void FrameStream::put(ByteView jpeg, std::int64_t unix_us) {
  out_ << fmt::format(
      "--nadir-frame\r\nContent-Type: image/jpeg\r\nContent-Length: {}\r\nX-Timestamp: {}.{:06}\r\n\r\n", jpeg.size(),
      unix_us / 1'000'000, unix_us % 1'000'000);
  out_.write(reinterpret_cast<const char*>(jpeg.data()), static_cast<std::streamsize>(jpeg.size()));
  out_ << "\r\n" << std::flush;
  if (!out_) {
    throw Error({.what = "the frames cannot be written",
                 .where = "standard output",
                 .expected = "a program that reads them",
                 .found = "the pipe was closed"});
  }
}

namespace {

constexpr std::size_t kMaxQueuedFrames = 256;

}  // namespace

DelayedSink::DelayedSink(FrameSink& sink) : sink_(sink), thread_([this](const std::stop_token& stop) { run(stop); }) {}

DelayedSink::~DelayedSink() = default;

void DelayedSink::put(Bytes jpeg, std::int64_t unix_us, Moment due) {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return failed_ || waiting_.size() < kMaxQueuedFrames; });
  throw_if_failed();
  waiting_.push_back({std::move(jpeg), unix_us, due});
  changed_.notify_all();
}

void DelayedSink::finish() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return failed_ || waiting_.empty(); });
  throw_if_failed();
}

int DelayedSink::delivered() const {
  const std::scoped_lock lock(mutex_);
  return delivered_;
}

void DelayedSink::throw_if_failed() const {
  if (failed_) std::rethrow_exception(failed_);
}

void DelayedSink::run(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (changed_.wait(lock, stop, [&] { return !waiting_.empty(); })) {
    const QueuedFrame& next = waiting_.front();  // only this thread pops, and a deque keeps references valid
    changed_.wait_until(lock, stop, next.due, [] { return false; });
    if (stop.stop_requested()) return;
    lock.unlock();
    std::exception_ptr failed;
    try {
      sink_.put(next.jpeg, next.unix_us);
    } catch (...) {
      failed = std::current_exception();
    }
    lock.lock();
    failed_ = failed;
    if (!failed) ++delivered_;
    waiting_.pop_front();
    changed_.notify_all();
    if (failed) return;
  }
}

}  // namespace nadir
