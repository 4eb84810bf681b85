// A metatile as bytes and back, for the build's journal. The journal's digests guard the bytes; the form is private to
// one version of the program.
#pragma once

#include <optional>

#include "package_build/metatile.hpp"

namespace nadir {

Bytes record_of(const Metatile& metatile);
std::optional<Metatile> metatile_from(ByteView record);  // nullopt when the bytes have another form

}  // namespace nadir
