#include "flight_import/camera_draft.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "geodesy/angles.hpp"
#include "geodesy/hypotenuse.hpp"

namespace nadir {
namespace {

// Makers' data sheets. The width is that of the image area in stills at full width.
struct KnownCamera {
  std::string_view make, model;
  double sensor_width_mm;
};
// clang-format off
constexpr KnownCamera kCameras[] = {
    {"DJI", "FC200", 6.17},
    {"DJI", "FC300C", 6.17},
    {"DJI", "FC300S", 6.17},
    {"DJI", "FC300X", 6.17},
    {"DJI", "FC330", 6.17},
    {"DJI", "FC350", 6.17},
    {"DJI", "FC220", 6.17},
    {"DJI", "FC1102", 6.17},
    {"DJI", "FC2103", 6.17},
    {"DJI", "FC2204", 6.17},
    {"DJI", "FC2403", 6.4},
    {"DJI", "FC7203", 6.17},
    {"DJI", "FC7303", 6.17},
    {"DJI", "FC3170", 6.4},
    {"DJI", "FC3411", 13.2},
    {"DJI", "FC3582", 9.6},
    {"DJI", "FC8482", 9.6},
    {"DJI", "FC550", 17.3},
    {"DJI", "FC550RAW", 17.3},
    {"DJI", "FC6310", 13.2},
    {"DJI", "FC6310S", 13.2},
    {"DJI", "FC6310R", 13.2},
    {"DJI", "FC6510", 13.2},
    {"DJI", "FC6520", 17.3},
    {"DJI", "FC6540", 23.5},
    {"Hasselblad", "L1D-20c", 13.2},
    {"Hasselblad", "L2D-20c", 17.3},
    {"DJI", "M3E", 17.3},
    {"DJI", "M4E", 17.3},
    {"DJI", "ZenmuseP1", 35.9},
    {"DJI", "ZenmuseL1", 13.2},
    {"DJI", "EP600", 17.3},
    {"SONY", "DSC-RX1R", 35.8},
    {"SONY", "DSC-RX1RM2", 35.9},
    {"SONY", "DSC-RX100", 13.2},
    {"SONY", "DSC-RX100M2", 13.2},
    {"SONY", "DSC-QX100", 13.2},
    {"SONY", "DSC-QX10", 6.17},
    {"SONY", "ILCE-QX1", 23.2},
    {"SONY", "ILCE-5000", 23.2},
    {"SONY", "ILCE-5100", 23.5},
    {"SONY", "ILCE-6000", 23.5},
    {"SONY", "ILCE-6100", 23.5},
    {"SONY", "ILCE-6300", 23.5},
    {"SONY", "ILCE-6400", 23.5},
    {"SONY", "ILCE-6500", 23.5},
    {"SONY", "ILCE-7", 35.8},
    {"SONY", "ILCE-7R", 35.9},
    {"SONY", "ILCE-7RM2", 35.9},
    {"SONY", "ILCE-7RM3", 35.9},
    {"SONY", "ILCE-7RM4", 35.7},
    {"SONY", "ILCE-7C", 35.6},
    {"SONY", "UMC-R10C", 23.2},
    {"SONY", "NEX-5", 23.4},
    {"SONY", "NEX-7", 23.5},
    {"Canon", "Canon PowerShot S100", 7.44},
    {"Canon", "Canon PowerShot S110", 7.44},
    {"Canon", "Canon PowerShot ELPH 110 HS", 6.17},
    {"Canon", "Canon IXUS 125 HS", 6.17},
    {"Canon", "Canon IXUS 127 HS", 6.17},
    {"Canon", "Canon PowerShot SX260 HS", 6.17},
    {"Canon", "Canon EOS M", 22.3},
    {"Canon", "Canon EOS 5D Mark II", 36},
    {"Canon", "Canon EOS 5D Mark III", 36},
    {"Canon", "Canon EOS 6D", 35.8},
    {"RICOH IMAGING COMPANY, LTD.", "GR", 23.7},
    {"RICOH IMAGING COMPANY, LTD.", "GR II", 23.7},
    {"RICOH IMAGING COMPANY, LTD.", "GR III", 23.5},
    {"Parrot", "Sequoia", 4.8},
    {"MicaSense", "RedEdge", 4.8},
    {"MicaSense", "RedEdge-M", 4.8},
    {"Parrot", "Anafi", 5.9},
    {"Phase One", "IXM-100", 43.9},
    {"PhaseOne", "iXM-100", 43.9},
    {"GoPro", "HERO3+ Black Edition", 6.17},
    {"GoPro", "HERO4 Black", 6.17},
};
// clang-format on

std::string plain_name(std::string_view text) {
  std::string name;
  for (const char c : text) {
    if (std::isalnum(static_cast<unsigned char>(c)) != 0) {
      name += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    }
  }
  return name;
}

std::string_view without(std::string_view text, std::string_view prefix) {
  return text.starts_with(prefix) && text.size() > prefix.size() ? text.substr(prefix.size()) : text;
}

constexpr double kFilmDiagonal_mm = 43.2666;  // 36 x 24 mm

std::optional<double> film_focal_px(const PhotoFacts& photo) {
  if (!photo.focal_35mm) return std::nullopt;
  return *photo.focal_35mm / kFilmDiagonal_mm * hypotenuse(photo.size.width, photo.size.height);
}

CameraModel pinhole(FrameSize size, double focal_px) {
  CameraModel camera;
  camera.width = size.width;
  camera.height = size.height;
  camera.fx = camera.fy = focal_px;
  camera.cx = (size.width - 1) / 2.0;
  camera.cy = (size.height - 1) / 2.0;
  return camera;
}

std::optional<CameraDraft> best_draft(const PhotoFacts& photo, const StatedLens& stated) {
  const double longer_px = std::max(photo.size.width, photo.size.height);
  const auto focal_mm = stated.focal_mm ? stated.focal_mm : photo.focal_mm;
  const char* focal_from = stated.focal_mm ? "--focal-mm" : "the photos";
  const auto from_width = [&](double width_mm, const std::string& width_from) {
    return CameraDraft{pinhole(photo.size, *focal_mm / width_mm * longer_px),
                       fmt::format("{} mm of {}, sensor {} mm wide by {}", *focal_mm, focal_from, width_mm, width_from),
                       {}};
  };
  if (stated.focal_px) return CameraDraft{pinhole(photo.size, *stated.focal_px), "--focal-px", {}};
  if (stated.sensor_width_mm && focal_mm) return from_width(*stated.sensor_width_mm, "--sensor-width-mm");
  if (photo.calibration && !stated.focal_mm) {
    return CameraDraft{*photo.calibration, "the maker's calibration in the photos (DewarpData)", {}};
  }
  if (photo.calibrated_focal_px && !stated.focal_mm) {
    return CameraDraft{
        pinhole(photo.size, *photo.calibrated_focal_px), "the maker's calibrated focal length in the photos", {}};
  }
  if (const auto known = known_sensor_width_mm(photo.make, photo.model); known && focal_mm) {
    return from_width(*known, "the table of cameras");
  }
  if (photo.sensor_px_per_mm && focal_mm) {
    const double focal_px = *focal_mm * *photo.sensor_px_per_mm;
    // Some cameras state the focal plane of another image size, or of nothing at all.
    if (focal_px > 0.2 * longer_px && focal_px < 50 * longer_px) {
      return CameraDraft{
          pinhole(photo.size, focal_px),
          fmt::format("{} mm of {} and the focal plane's resolution in the photos", *focal_mm, focal_from),
          {}};
    }
  }
  if (const auto film = film_focal_px(photo)) {
    return CameraDraft{pinhole(photo.size, *film),
                       fmt::format("{} mm for 35 mm film, rounded to a millimetre", *photo.focal_35mm),
                       {}};
  }
  return std::nullopt;
}

}  // namespace

std::optional<double> known_sensor_width_mm(std::string_view make, std::string_view model) {
  const std::string wanted_make = plain_name(make), wanted = plain_name(model);
  if (wanted.empty()) return std::nullopt;
  for (const KnownCamera& known : kCameras) {
    const std::string known_make = plain_name(known.make), known_model = plain_name(known.model);
    const bool same_make =
        wanted_make.empty() || wanted_make.starts_with(known_make) || known_make.starts_with(wanted_make);
    if (same_make && without(wanted, wanted_make) == without(known_model, known_make)) return known.sensor_width_mm;
  }
  return std::nullopt;
}

std::optional<CameraDraft> draft_camera(const PhotoFacts& photo, const StatedLens& stated) {
  auto draft = best_draft(photo, stated);
  if (!draft) return std::nullopt;
  constexpr double kTolerated = 1.15;  // 7 % off are usual where a mode crops the sensor
  if (const auto film = film_focal_px(photo)) {
    const double factor = *film / draft->camera.fx;
    if (factor > kTolerated || factor < 1 / kTolerated) draft->disagreement = factor;
  }
  return draft;
}

std::string draft_yaml(const CameraDraft& draft, const TelemetryUncertainty& uncertainty, std::string_view taken_with) {
  const CameraModel& camera = draft.camera;
  std::string distortion;
  if (camera.distorted()) {
    for (const double value : camera.distortion)
      distortion += fmt::format("{}{}", distortion.empty() ? "" : ", ", value);
  }
  return fmt::format(
      "# A draft that `nadir flight import` made of photos {}.\n"
      "# Focal length: {}.\n"
      "# `nadir provision camera` calibrates. Review what ends with \"# check\".\n"
      "model: pinhole\n"
      "width: {}\nheight: {}\n"
      "fx: {:.2f}  # check\nfy: {:.2f}  # check\ncx: {:.2f}\ncy: {:.2f}\n"
      "distortion: [{}]{}\n"
      "uncertainty:  # 1-sigma errors of the telemetry\n"
      "  heading_deg: {:.1f}  # check\n"
      "  agl_relative: {:.2f}  # check\n"
      "  tilt_deg: {:.1f}  # check\n",
      taken_with, draft.from, camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, distortion,
      camera.distorted() ? "" : "  # check: not known, taken as none", degrees(uncertainty.heading_rad),
      uncertainty.agl_relative, degrees(uncertainty.tilt_rad));
}

}  // namespace nadir
