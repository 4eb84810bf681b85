// `nadir simulate camera`: pictures in real time of what an autopilot's simulator flies over.
#pragma once

#include "cli/command.hpp"
#include "simulation/camera_simulation.hpp"

namespace nadir {

class SimulateCameraCommand final : public Command {
 public:
  std::string_view group() const override { return "simulate"; }
  std::string_view name() const override { return "camera"; }
  std::string_view summary() const override { return "see a world from where an autopilot's simulator flies"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }
  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  void report(Context& context, const CameraSimulationReport& report, bool on_stdout) const;

  LiveCameraOptions camera_;
  CameraSimulationOptions film_;
  std::string poses_;
  std::string noise_ = "real";
  std::filesystem::path out_;
  std::optional<int> keep_;
  std::optional<double> delay_s_, wait_s_;
};

}  // namespace nadir
