// A camera behind a plug-in: a library that is loaded on demand, so that the service itself links no video library
// (plugin_abi.h). Recordings are played at their own speed by the service's clock.
#pragma once

#include <array>
#include <filesystem>
#include <memory>
#include <string>

#include "camera/camera_source.hpp"
#include "service/clock.hpp"

namespace nadir {

class CameraPlugin;  // the loaded library

class PluginCamera final : public CameraSource {
 public:
  // Loads the library; next() opens the camera and reopens it after failures. Throws Error when the file is not a
  // plug-in, or of another version.
  PluginCamera(const std::filesystem::path& library, std::string source, const FlightClock& clock);
  ~PluginCamera() override;

  CameraReading next(std::chrono::milliseconds at_most, std::stop_token stop) override;
  std::string describe() const override;

 private:
  struct PendingFrame {
    CameraFrame frame;
    double due_s = 0;
  };

  std::string spoken(std::array<char, 256>& error) const;
  std::optional<CameraReading> open();
  CameraReading read(std::chrono::milliseconds at_most);
  CameraReading hold_until_due(double until_s, const std::stop_token& stop);
  void close();

  std::unique_ptr<CameraPlugin> plugin_;
  std::string source_;
  const FlightClock& clock_;
  void* camera_ = nullptr;
  std::uint64_t frames_ = 0;
  std::optional<double> media_start_s_;  // monotonic time of the recording's start
  std::optional<PendingFrame> pending_;  // a frame of a recording that is not due yet
};

}  // namespace nadir
