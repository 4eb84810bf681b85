#include "camera/plugin_camera.hpp"

#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "base/error.hpp"
#include "camera/plugin_abi.h"

namespace nadir {
namespace {

constexpr std::int32_t kMaxSide = 20'000;
constexpr std::size_t kMaxEncodedSize = std::size_t{1} << 28;

using ErrorText256 = std::array<char, 256>;

std::string text_of(ErrorText256& error) {
  error.back() = '\0';
  return error.front() == '\0' ? "no reason given" : error.data();
}

// The plug-in's description of its frame is not trusted.
bool plausible(const NadirPluginFrame& frame) {
  if (frame.data == nullptr || !std::isfinite(frame.media_time_s) || !std::isfinite(frame.age_s)) return false;
  if (frame.width == 0) return frame.size > 0 && frame.size <= kMaxEncodedSize;
  const auto side = [](std::int32_t length) { return length > 0 && length <= kMaxSide; };
  if (!side(frame.width) || !side(frame.height) || (frame.channels != 1 && frame.channels != 3)) return false;
  const auto cells = static_cast<std::size_t>(frame.width) * static_cast<std::size_t>(frame.height);
  return frame.size == cells * static_cast<std::size_t>(frame.channels);
}

}  // namespace

class CameraPlugin {
 public:
  explicit CameraPlugin(const std::filesystem::path& library)
      : handle_(::dlopen(library.c_str(), RTLD_NOW | RTLD_LOCAL)) {
    if (handle_ == nullptr) {
      const char* why = ::dlerror();  // NOLINT(concurrency-mt-unsafe): glibc keeps one text per thread
      throw Error({.what = "cannot load the camera plug-in",
                   .where = library,
                   .found = why == nullptr ? "no reason given" : why,
                   .fix = "install the plug-in, or use a folder as the camera"});
    }
    using Entry = const NadirCameraPlugin* (*)();
    const auto entry = reinterpret_cast<Entry>(::dlsym(handle_, "nadir_camera_plugin"));
    table_ = entry == nullptr ? nullptr : entry();
    if (table_ == nullptr || table_->version != NADIR_CAMERA_PLUGIN_VERSION) {
      const std::string found = table_ == nullptr ? "none" : fmt::format("version {}", table_->version);
      ::dlclose(handle_);
      throw Error({.what = "not a camera plug-in for this service",
                   .where = library,
                   .expected = fmt::format("nadir_camera_plugin of version {}", NADIR_CAMERA_PLUGIN_VERSION),
                   .found = found,
                   .fix = "rebuild the plug-in with this version of the service"});
    }
  }
  ~CameraPlugin() { ::dlclose(handle_); }
  CameraPlugin(const CameraPlugin&) = delete;
  CameraPlugin& operator=(const CameraPlugin&) = delete;

  const NadirCameraPlugin* operator->() const { return table_; }

 private:
  void* handle_;
  const NadirCameraPlugin* table_ = nullptr;
};

PluginCamera::PluginCamera(const std::filesystem::path& library, std::string source, const FlightClock& clock)
    : plugin_(std::make_unique<CameraPlugin>(library)), source_(std::move(source)), clock_(clock) {}

PluginCamera::~PluginCamera() { close(); }

std::string PluginCamera::describe() const {
  return fmt::format("{} (plug-in {})", redacted(source_), (*plugin_)->name == nullptr ? "unnamed" : (*plugin_)->name);
}

void PluginCamera::close() {
  if (camera_ != nullptr) (*plugin_)->close(std::exchange(camera_, nullptr));
  media_start_s_.reset();
}

// The plug-in's message without the address that it was given, which may contain a password.
std::string PluginCamera::spoken(std::array<char, 256>& error) const {
  std::string text = text_of(error);
  for (std::size_t at = text.find(source_); at != std::string::npos; at = text.find(source_)) {
    text.replace(at, source_.size(), redacted(source_));
    if (redacted(source_) == source_) break;
  }
  return text;
}

std::optional<CameraReading> PluginCamera::open() {
  ErrorText256 error{};
  camera_ = (*plugin_)->open(source_.c_str(), error.data(), error.size());
  if (camera_ != nullptr) return std::nullopt;
  return CameraReading{CameraStatus::failure, {}, fmt::format("cannot open {}: {}", redacted(source_), spoken(error))};
}

CameraReading PluginCamera::read(std::chrono::milliseconds at_most) {
  NadirPluginFrame seen{};
  ErrorText256 error{};
  const auto timeout_ms = static_cast<std::int32_t>(std::clamp<std::int64_t>(at_most.count(), 0, 60'000));
  const std::int32_t status = (*plugin_)->read(camera_, timeout_ms, &seen, error.data(), error.size());
  if (status == NADIR_CAMERA_NOTHING) return {};
  if (status == NADIR_CAMERA_ENDED) return {CameraStatus::ended, {}, "the end of " + redacted(source_)};
  if (status != NADIR_CAMERA_FRAME || !plausible(seen)) {
    close();
    return {CameraStatus::failure, {}, status == NADIR_CAMERA_FRAME ? "invalid frame from the plug-in" : spoken(error)};
  }
  CameraFrame frame{fmt::format("{:06}", frames_++), clock_.monotonic_s(), Bytes(seen.data, seen.data + seen.size), {}};
  if (seen.age_s >= 0) frame.age_s = seen.age_s;
  if (seen.width != 0) frame.raw = RawPixels{seen.width, seen.height, seen.channels};
  if (seen.media_time_s < 0) return {CameraStatus::frame, std::move(frame), {}};
  if (!media_start_s_) media_start_s_ = frame.time_s - seen.media_time_s;
  pending_ = PendingFrame{std::move(frame), *media_start_s_ + seen.media_time_s};
  return {};
}

CameraReading PluginCamera::hold_until_due(double until_s, const std::stop_token& stop) {
  clock_.wait_until(std::min(pending_->due_s, until_s), stop);
  const double now_s = clock_.monotonic_s();
  if (now_s < pending_->due_s) return {};
  CameraReading reading{CameraStatus::frame, std::move(pending_->frame), {}};
  reading.frame.time_s = now_s;
  pending_.reset();
  return reading;
}

CameraReading PluginCamera::next(std::chrono::milliseconds at_most, std::stop_token stop) {
  const double until_s = clock_.monotonic_s() + 1e-3 * static_cast<double>(at_most.count());
  if (!pending_) {
    if (camera_ == nullptr) {
      if (auto failed = open()) {
        clock_.wait_until(until_s, stop);
        return std::move(*failed);
      }
    }
    CameraReading reading = read(at_most);
    if (!pending_) return reading;
  }
  return hold_until_due(until_s, stop);
}

}  // namespace nadir
