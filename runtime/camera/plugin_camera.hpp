// A camera behind a plug-in: a library that is loaded when it is asked for, so that the service itself links no video
// library (plugin_abi.h). Recordings are played at their own speed by the service's clock.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "camera/camera_source.hpp"
#include "service/clock.hpp"

namespace nadir {

class CameraPlugin;  // the loaded library

class PluginCamera final : public CameraSource {
 public:
  // Loads the library; the camera itself is opened by next(), again and again if need be. Throws Error when the file is
  // no plug-in, or one of another version.
  PluginCamera(const std::filesystem::path& library, std::string source, const FlightClock& clock);
  ~PluginCamera() override;

  CameraReading next(std::chrono::milliseconds at_most, std::stop_token stop) override;
  std::string describe() const override;

 private:
  struct Waiting {
    CameraFrame frame;
    double due_s = 0;
  };

  std::optional<CameraReading> open();
  CameraReading read(std::chrono::milliseconds at_most);
  CameraReading hold_until_due(double until_s, const std::stop_token& stop);
  void close();

  std::unique_ptr<CameraPlugin> plugin_;
  std::string source_;
  const FlightClock& clock_;
  void* camera_ = nullptr;
  std::uint64_t frames_ = 0;
  std::optional<double> media_start_s_;  // monotonic time of the recording's beginning
  std::optional<Waiting> waiting_;       // a frame of a recording whose time has not come
};

}  // namespace nadir
