// nadir provision boresight: how the camera sits in the aircraft, from a flight during which GPS was good.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "base/time.hpp"
#include "cli/command.hpp"
#include "provision/boresight.hpp"
#include "replay/flight_folder.hpp"

namespace nadir {

class ProvisionBoresightCommand final : public Command {
 public:
  std::string_view group() const override { return "provision"; }
  std::string_view name() const override { return "boresight"; }
  std::string_view summary() const override { return "find how the camera is mounted from a flight with good GPS"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  Flight read_flight_segment(const std::filesystem::path& unpacked) const;
  int report(Context& context, const Findings& findings, const std::optional<Boresight>& boresight,
             std::size_t looked_at, double delay_s) const;

  std::filesystem::path airframe_, package_, trust_;
  std::optional<std::filesystem::path> frames_, telemetry_, recorder_, key_, out_;
  std::optional<std::string> session_;
  std::optional<double> from_s_, to_s_;
  std::optional<UtcTime> at_;
  double gps_sigma_m_ = 1.5;
  int most_frames_ = 150;
  BoresightLimits limits_;
};

}  // namespace nadir
