#include "recorder/record_codec.hpp"

#include <memory>

#include "recorder/codec_parts.hpp"

namespace nadir {
namespace {

template <std::size_t Alternative = 0>
std::optional<Record> decode_alternative(std::size_t which, ByteView bytes) {
  if constexpr (Alternative < kTopics) {
    if (which != Alternative) return decode_alternative<Alternative + 1>(which, bytes);
    std::variant_alternative_t<Alternative, Record> record;
    if (!codec::decode(bytes, record)) return std::nullopt;
    return Record(std::in_place_index<Alternative>, std::move(record));
  } else {
    return std::nullopt;
  }
}

}  // namespace

static_assert(std::variant_size_v<Record> == kTopics);

std::string_view name_of(RecorderTrouble trouble) {
  switch (trouble) {
    case RecorderTrouble::dropped_by_queue: return "dropped_by_queue";
    case RecorderTrouble::dropped_by_disk: return "dropped_by_disk";
    case RecorderTrouble::stopped: return "stopped";
    case RecorderTrouble::resumed: return "resumed";
    case RecorderTrouble::segment_deleted: return "segment_deleted";
  }
  return "stopped";
}

Bytes encode(const Record& record) {
  return std::visit([](const auto& kind) { return codec::encode(kind); }, record);
}

std::optional<Record> decode(Topic topic, ByteView bytes) {
  // FlatBuffers reads numbers where they lie; a message may begin anywhere in its chunk.
  constexpr std::size_t kAlignment = 16;
  if (reinterpret_cast<std::uintptr_t>(bytes.data()) % kAlignment == 0) {
    return decode_alternative(static_cast<std::size_t>(topic), bytes);
  }
  const Bytes aligned(bytes.begin(), bytes.end());
  return decode_alternative(static_cast<std::size_t>(topic), aligned);
}

}  // namespace nadir
