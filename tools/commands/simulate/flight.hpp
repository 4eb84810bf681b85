// `nadir simulate flight`: a flight over any georeferenced picture.
#pragma once

#include "cli/command.hpp"
#include "simulation/flight.hpp"

namespace nadir {

class SimulateFlightCommand final : public Command {
 public:
  std::string_view group() const override { return "simulate"; }
  std::string_view name() const override { return "flight"; }
  std::string_view summary() const override { return "fly a mission over a raster: frames, telemetry and exact truth"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }
  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  SimulatedFlightOptions options_;
  std::filesystem::path mission_;
  std::string noise_ = "real";
  std::filesystem::path out_;
};

}  // namespace nadir
