// Pictures of a failure, small enough to keep hundreds of them.
#pragma once

#include "recorder/recorder.hpp"

namespace nadir {

// No side longer than 320 pixels, JPEG of quality 70: some 15 kB each.
ThumbnailRecord thumbnail_record(const ThumbnailPictures& pictures);

}  // namespace nadir
