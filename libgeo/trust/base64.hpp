// Base64 (RFC 4648, section 4) for signatures in JSON: canonical only, so that a signature has exactly one spelling.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "base/bytes.hpp"

namespace nadir {

std::string to_base64(ByteView bytes);

// nullopt for other characters, line breaks, missing padding and unused bits that are not zero.
std::optional<Bytes> from_base64(std::string_view text);

}  // namespace nadir
