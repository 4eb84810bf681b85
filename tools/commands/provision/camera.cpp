// nadir provision camera: a camera model from images of a checkerboard.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <ostream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "provision/camera_calibration.hpp"

namespace nadir {
namespace {

class ProvisionCameraCommand final : public Command {
 public:
  std::string_view group() const override { return "provision"; }
  std::string_view name() const override { return "camera"; }
  std::string_view summary() const override { return "calibrate a camera from images of a checkerboard"; }
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

std::string_view ProvisionCameraCommand::details() const {
  return R"(Take 10 to 30 sharp images of a flat checkerboard, at the resolution and focus used in flight: the
board in the middle and at every edge, straight on and tilted by 20 to 45 degrees. --board counts
inner corners, where four squares meet.

The file is written if every check passes; an existing file is never replaced.

Exit codes: 0 written, 1 the images do not determine the camera, 2 the job could not be done.)";
}

std::string_view ProvisionCameraCommand::examples() const {
  return R"(nadir provision camera --images board --board 9x6 --square-m 0.025 --out camera.yaml)";
}

void ProvisionCameraCommand::setup(Options& options) {
  options.value("--images", pictures_, "DIR", "folder with JPEG or PNG images of the board")
      .required()
      .formerly("--pictures");
  options.value("--board", board_, "CxR", "inner corners across and down").required();
  options.value("--square-m", square_m_, "M", "side of a square").required().between(0.001, 10);
  options.value("--out", out_, "FILE.yaml", "camera file to create").required();
  options.value("--min-images", limits_.min_views, "N", "minimum number of images that show the board")
      .between(3, 1000)
      .formerly("--min-pictures");
  options.value("--max-residual-px", limits_.max_residual_px, "PX", "maximum residual of the fit").between(0.01, 10);
}

int ProvisionCameraCommand::run(Context& context) {
  if (std::filesystem::exists(std::filesystem::symlink_status(out_))) {
    throw UsageError({.what = "the output already exists",
                      .where = out_,
                      .expected = "a new file",
                      .fix = "move it away, or choose another --out"});
  }
  const Board board = parse_board(board_, square_m_);
  const BoardImages pictures = find_boards(pictures_, board, context.progress);
  Findings findings = check_views(pictures, limits_);
  if (findings.has_errors()) return report_findings(context.out, context.json, findings);
  const Calibration calibration = calibrate(pictures, board);
  findings.add(check_calibration(calibration, limits_));
  if (!findings.has_errors()) write_file_atomic(out_, camera_yaml(calibration.camera));
  return report(context, findings, pictures, calibration);
}

int ProvisionCameraCommand::report(Context& context, const Findings& findings, const BoardImages& pictures,
                                   const Calibration& calibration) const {
  const CameraModel& camera = calibration.camera;
  if (context.json) {
    return report_findings(context.out, true, findings,
                           {{"pictures_used", pictures.views.size()},
                            {"pictures_set_aside", pictures.rejected.size()},
                            {"residual_px", calibration.residual_px},
                            {"worst_picture", calibration.worst_view},
                            {"worst_picture_px", calibration.worst_view_px},
                            {"focal_sigma_relative", calibration.focal_sigma},
                            {"coverage", {calibration.coverage_across, calibration.coverage_down}},
                            {"fx", camera.fx},
                            {"fy", camera.fy},
                            {"cx", camera.cx},
                            {"cy", camera.cy},
                            {"distortion", camera.distortion}});
  }
  if (!findings.empty()) print_findings(context.out, findings);
  print_figures(context.out,
                {{"images", fmt::format("{} used, {} rejected", pictures.views.size(), pictures.rejected.size())},
                 {"focal lengths",
                  fmt::format("{:.2f}, {:.2f} px (σ {:.3f} %)", camera.fx, camera.fy, calibration.focal_sigma * 100)},
                 {"centre", fmt::format("{:.2f}, {:.2f} px", camera.cx, camera.cy)},
                 {"residual", fmt::format("{:.3f} px, at most {:.3f} px in {}", calibration.residual_px,
                                          calibration.worst_view_px, calibration.worst_view)},
                 {"written", findings.has_errors() ? "nothing" : out_.string()}});
  return findings.has_errors() ? kRefused : kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_provision_camera() { return std::make_unique<ProvisionCameraCommand>(); }

}  // namespace nadir
