// The two forms in which pictures are held: one grey channel, or blue, green, red. 8 bit each.
#pragma once

namespace nadir {

enum class Colour { grey, bgr };

}  // namespace nadir
