// `nadir replay`: flies recorded pictures and telemetry through the localizer and reports how it went.
#pragma once

#include <filesystem>
#include <optional>

#include "cli/command.hpp"
#include "replay/flight_request.hpp"

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
  FlightRequest request_{"nadir replay"};
  std::optional<std::filesystem::path> truth_;
  std::filesystem::path out_;
  std::optional<std::filesystem::path> record_;
  bool keep_frames_ = false;
};

}  // namespace nadir
