// Whether a picture that somebody offers may become a frame of a flight: one clear answer for each.
//
// This module looks at one picture by itself: its name, its time, its bytes, and the size that its header declares. No
// pixel is decoded: a picture whose pixels are damaged is accepted, and the localizer reports its frame as unfit. What
// depends on the pictures before it (names and contents that are there already, the order of time) the PictureIntake
// adds.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include "base/bytes.hpp"
#include "base/digest.hpp"
#include "imagery/codecs.hpp"
#include "vision/camera.hpp"

namespace nadir {

// Why a picture was refused. The names are stable.
enum class PictureProblem {
  bad_name,         // not the plain name of a file
  bad_time,         // not a number
  not_a_file,       // a link, a folder, a device; or it cannot be read
  empty,            // 0 bytes
  too_large,        // more bytes than a picture may have
  unknown_type,     // neither JPEG nor PNG nor WebP
  damaged_header,   // of one of these, but its header cannot be read
  too_many_pixels,  // declared by its header
  other_camera,     // its size is not that of the flight's camera
  name_taken,       // another picture of the flight has this name
  content_known,    // another picture of the flight has the same bytes
  out_of_order,     // not later than the picture before it
  flight_full       // the flight holds as many pictures, or bytes, as it may
};

std::string_view name_of(PictureProblem problem);
std::optional<PictureProblem> parse_picture_problem(std::string_view name);

struct PictureLimits {
  std::size_t batch_pictures = 200;  // each is an open file until the batch is stored
  std::uint64_t picture_bytes = std::uint64_t{256} << 20;
  std::int64_t picture_pixels = 200'000'000;
  std::size_t flight_pictures = 100'000;
  std::uint64_t flight_bytes = std::uint64_t{1} << 40;
  std::size_t stored_refusals = 10'000;  // of a flight; further ones are answered, but not stored
};

struct PictureRefusal {
  PictureProblem problem = PictureProblem::bad_name;
  std::string reason;  // for people: expected, found
};

struct PictureFacts {
  ImageFormat format = ImageFormat::jpeg;
  int width = 0;  // pixels
  int height = 0;
  std::uint64_t bytes = 0;
  Sha256 sha256;
};

// A plain name of at most 255 bytes: printable UTF-8, no separator of folders, not hidden.
bool plain_picture_name(std::string_view name);

std::variant<PictureFacts, PictureRefusal> check_picture(std::string_view name, double time_s, ByteView bytes,
                                                         const CameraModel& camera, const PictureLimits& limits);

}  // namespace nadir
