// Where pictures come from. A source is read by one thread of its own, which puts each picture into the localizer's
// mailbox; it owns no clock but the one that it is given, and knows no picture library.
#pragma once

#include <chrono>
#include <optional>
#include <stop_token>
#include <string>

#include "base/bytes.hpp"

namespace nadir {

// Pixels as some cameras give them: rows from the top, without gaps, 1 (grey) or 3 (BGR) bytes a pixel.
struct RawPixels {
  int width = 0;
  int height = 0;
  int channels = 3;
};

struct CameraFrame {
  std::string name;              // of the file, or a number that counts up
  double time_s = 0;             // monotonic, when the picture was there
  Bytes bytes;                   // an encoded picture (JPEG, PNG, WebP), or pixels
  std::optional<RawPixels> raw;  // how to read them when they are pixels
};

enum class CameraNews {
  frame,    // here is one
  nothing,  // none within the time, or stop was requested
  trouble,  // the camera is gone, or gives what is no picture; it may come back: ask again
  ended,    // there will be no more: the end of a video
};

struct CameraReading {
  CameraNews news = CameraNews::nothing;
  CameraFrame frame{};   // with CameraNews::frame
  std::string detail{};  // for the recorder, with trouble and ended
};

class CameraSource {
 public:
  virtual ~CameraSource() = default;

  // Waits for the next picture, but not for longer than at_most. Never throws for what a camera does in flight.
  virtual CameraReading next(std::chrono::milliseconds at_most, std::stop_token stop) = 0;

  virtual std::string describe() const = 0;  // "folder /data/frames"
};

}  // namespace nadir
