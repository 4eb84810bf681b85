#include "flights/picture_check.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>

#include "base/error.hpp"
#include "base/printable.hpp"

namespace nadir {
namespace {

constexpr std::size_t kMaxName_bytes = 255;

constexpr std::array<PictureProblem, 13> kProblems{
    PictureProblem::bad_name,       PictureProblem::bad_time,        PictureProblem::not_a_file,
    PictureProblem::empty,          PictureProblem::too_large,       PictureProblem::unknown_type,
    PictureProblem::damaged_header, PictureProblem::too_many_pixels, PictureProblem::other_camera,
    PictureProblem::name_taken,     PictureProblem::content_known,   PictureProblem::out_of_order,
    PictureProblem::flight_full};

}  // namespace

std::string_view name_of(PictureProblem problem) {
  switch (problem) {
    case PictureProblem::bad_name: return "bad_name";
    case PictureProblem::bad_time: return "bad_time";
    case PictureProblem::not_a_file: return "not_a_file";
    case PictureProblem::empty: return "empty";
    case PictureProblem::too_large: return "too_large";
    case PictureProblem::unknown_type: return "unknown_type";
    case PictureProblem::damaged_header: return "damaged_header";
    case PictureProblem::too_many_pixels: return "too_many_pixels";
    case PictureProblem::other_camera: return "other_camera";
    case PictureProblem::name_taken: return "name_taken";
    case PictureProblem::content_known: return "content_known";
    case PictureProblem::out_of_order: return "out_of_order";
    case PictureProblem::flight_full: return "flight_full";
  }
  return {};
}

std::optional<PictureProblem> parse_picture_problem(std::string_view name) {
  for (const PictureProblem problem : kProblems) {
    if (name_of(problem) == name) return problem;
  }
  return std::nullopt;
}

bool plain_picture_name(std::string_view name) {
  return !name.empty() && name.size() <= kMaxName_bytes && name.front() != '.' &&
         name.find_first_of("/\\") == std::string_view::npos && printable(name) == name;
}

std::variant<PictureFacts, PictureRefusal> check_picture(std::string_view name, double time_s, ByteView bytes,
                                                         const CameraModel& camera, const PictureLimits& limits) {
  if (!plain_picture_name(name)) {
    return PictureRefusal{PictureProblem::bad_name, "expected the plain name of a file, such as 0001.jpg"};
  }
  if (!std::isfinite(time_s)) return PictureRefusal{PictureProblem::bad_time, "expected its time in seconds"};
  if (bytes.empty()) return PictureRefusal{PictureProblem::empty, "the file has 0 bytes"};
  if (bytes.size() > limits.picture_bytes) {
    return PictureRefusal{PictureProblem::too_large,
                          fmt::format("expected at most {} bytes, found {}", limits.picture_bytes, bytes.size())};
  }
  if (!sniff_image_format(bytes)) {
    return PictureRefusal{PictureProblem::unknown_type, "expected a JPEG, PNG or WebP image, found other bytes"};
  }
  ImageInfo info;
  try {
    info = read_image_info(bytes, name);
  } catch (const Error& error) {
    return PictureRefusal{PictureProblem::damaged_header,
                          fmt::format("expected {}, found {}", error.text().expected, error.text().found)};
  }
  if (std::int64_t{info.width} * info.height > limits.picture_pixels) {
    return PictureRefusal{PictureProblem::too_many_pixels, fmt::format("expected at most {} pixels, found {}×{}",
                                                                       limits.picture_pixels, info.width, info.height)};
  }
  if (info.width != camera.width || info.height != camera.height) {
    return PictureRefusal{PictureProblem::other_camera,
                          fmt::format("expected {}×{} pixels, as the flight's camera has, found {}×{}", camera.width,
                                      camera.height, info.width, info.height)};
  }
  return PictureFacts{info.format, info.width, info.height, bytes.size(), sha256(bytes)};
}

}  // namespace nadir
