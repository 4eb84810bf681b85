// nadir provision camera: a camera model from pictures of a checkerboard.
#pragma once

#include <filesystem>

#include "cli/command.hpp"
#include "provision/camera_calibration.hpp"

namespace nadir {

class ProvisionCameraCommand final : public Command {
 public:
  std::string_view group() const override { return "provision"; }
  std::string_view name() const override { return "camera"; }
  std::string_view summary() const override { return "calibrate a camera from pictures of a checkerboard"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  int report(Context& context, const Findings& findings, const BoardImages& pictures,
             const Calibration& calibration) const;

  std::filesystem::path pictures_, out_;
  std::string board_;
  double square_m_ = 0;
  CalibrationLimits limits_;
};

}  // namespace nadir
