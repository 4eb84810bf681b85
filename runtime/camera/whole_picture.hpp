// Whether a file that was read holds a picture from its first byte to its last, by the marks that the formats begin and
// end with. Nothing is decoded: this finds what is still being written or was cut off, not what is damaged inside.
#pragma once

#include <filesystem>

#include "base/bytes.hpp"

namespace nadir {

// JPEG, PNG or WebP. What follows the end is ignored, as decoders do.
bool is_whole_picture(ByteView bytes);

// Whether a file of this name is taken for a picture: .jpg, .jpeg, .png, .webp in any case, and not hidden.
bool has_picture_name(const std::filesystem::path& name);

}  // namespace nadir
