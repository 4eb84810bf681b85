// Logs of autopilots, written by hand from the published formats, of one simulated flight.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "vision/camera.hpp"

namespace nadir::test {

// What flew: legs with turns between them, climbing from 100 m.
struct SampleFlight {
  double begin_s = 100, end_s = 220;  // since boot
  double unix_from_boot_s = 1'782'000'000;
  int inertial_hz = 0;  // samples of gyroscopes and accelerometers in the logs of the autopilots
  double height_at(double time_s) const { return 100 + 0.1 * (time_s - begin_s); }
  Attitude attitude_at(double time_s) const;
  // As the gyroscopes of an aircraft have it: forward, right, down.
  Eigen::Vector3d rate_at(double time_s) const;
  double lon_at(double time_s) const { return 8.5 + 1e-4 * (time_s - begin_s); }
  double lat_at(double time_s) const { return 47.4 + 5e-5 * (time_s - begin_s); }
};

class DataflashWriter {
 public:
  DataflashWriter();
  void format(std::uint8_t type, std::string_view name, std::string_view types, std::string_view columns);
  void record(std::uint8_t type, const Bytes& body);
  Bytes bytes;
};

class UlogWriter {
 public:
  explicit UlogWriter(bool flags = true);
  void message(char type, ByteView body);
  void format(std::string_view text) { message('F', as_bytes(text)); }
  void subscribe(std::uint16_t id, std::string_view topic, std::uint8_t instance = 0);
  void data(std::uint16_t id, const Bytes& body);
  Bytes bytes;
};

// Numbers as little-endian bytes, one after the other.
class Packed {
 public:
  template <class Number>
  Packed& put(Number value) {
    const auto* raw = reinterpret_cast<const std::uint8_t*>(&value);
    for (std::size_t i = 0; i < sizeof(Number); ++i) bytes_.push_back(raw[i]);
    return *this;
  }
  operator Bytes() const { return bytes_; }  // NOLINT(google-explicit-constructor)

 private:
  Bytes bytes_;
};

Bytes sample_dataflash(const SampleFlight& flight, const std::vector<double>& triggers_s);
Bytes sample_ulog(const SampleFlight& flight, const std::vector<double>& triggers_s);
// Written by pymavlink, for each message {"at": arrival, "message": NAME, …} of JSON.
Bytes sample_tlog(const SampleFlight& flight, const std::vector<double>& triggers_s, double delay_s = 0.2);

}  // namespace nadir::test
