// `nadir replay`: flies recorded pictures and telemetry through the localizer and reports how it went.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "framework/command.hpp"
#include "geodesy/lon_lat.hpp"
#include "replay/flight_folder.hpp"
#include "replay/flight_recording.hpp"

namespace nadir {

class ReplayCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "replay"; }
  std::string_view summary() const override { return "fly recorded frames and telemetry through the localizer"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  Flight flight_to_fly(Context& context, const std::filesystem::path& unpacked,
                       std::optional<RecordedFlight>& recorded);
  void check_options() const;

  std::optional<std::filesystem::path> package_;
  std::optional<std::filesystem::path> trust_;
  std::optional<std::string> airframe_;
  std::optional<UtcTime> at_;
  std::optional<std::filesystem::path> frames_, telemetry_, camera_;
  std::optional<std::filesystem::path> truth_;
  std::optional<LonLat> start_;
  std::string odometry_ = "features";
  std::string matcher_ = "channels";
  std::filesystem::path out_;
  std::optional<std::filesystem::path> record_;
  bool keep_frames_ = false;
  std::optional<std::filesystem::path> recorder_;
  std::optional<std::string> session_;
};

}  // namespace nadir
