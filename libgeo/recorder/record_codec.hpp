// Records as FlatBuffers and back, bit for bit.
#pragma once

#include <optional>

#include "recorder/records.hpp"

namespace nadir {

Bytes encode(const Record& record);

// Nothing for bytes that are no record of this topic: they are verified before they are read.
std::optional<Record> decode(Topic topic, ByteView bytes);

}  // namespace nadir
