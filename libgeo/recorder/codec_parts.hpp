// What the codecs of the records share. Included by .cpp files only.
#pragma once

#include <cstddef>
#include <string>

#include "base/bytes.hpp"
#include "fbs/common_generated.h"
#include "geodesy/lon_lat.hpp"
#include "recorder/records.hpp"

namespace nadir::codec {

namespace fbs = nadir::recorder;
using flatbuffers::FlatBufferBuilder;

inline std::string text(const flatbuffers::String* text) { return text == nullptr ? std::string() : text->str(); }

inline Bytes bytes(const flatbuffers::Vector<std::uint8_t>* bytes) {
  return bytes == nullptr ? Bytes() : Bytes(bytes->begin(), bytes->end());
}

template <typename Number>
std::optional<double> optional(const Number& number) {
  return number ? std::optional<double>(*number) : std::nullopt;
}

inline flatbuffers::Optional<double> optional(const std::optional<double>& number) {
  return number ? flatbuffers::Optional<double>(*number) : flatbuffers::nullopt;
}

inline fbs::LonLat place(LonLat place) { return {place.lon_deg, place.lat_deg}; }

inline std::optional<LonLat> place(const fbs::LonLat* place) {
  if (place == nullptr) return std::nullopt;
  return LonLat{place->lon_deg(), place->lat_deg()};
}

inline fbs::AnchorVerdict verdict(AnchorVerdict verdict) {
  return static_cast<fbs::AnchorVerdict>(static_cast<std::uint8_t>(verdict));
}

// What a later version may call something else is "not tried" to this one.
inline AnchorVerdict verdict(fbs::AnchorVerdict verdict) {
  if (verdict > fbs::AnchorVerdict::MAX) return AnchorVerdict::not_tried;
  return static_cast<AnchorVerdict>(static_cast<std::uint8_t>(verdict));
}

template <typename Table>
Bytes finish(FlatBufferBuilder& builder, flatbuffers::Offset<Table> root) {
  builder.Finish(root);
  return {builder.GetBufferPointer(), builder.GetBufferPointer() + builder.GetSize()};
}

// The table, or null for bytes that are none.
template <typename Table>
const Table* verified(ByteView bytes) {
  flatbuffers::Verifier verifier(bytes.data(), bytes.size(), 16, 100'000);
  if (bytes.size() < 8 || !verifier.VerifyBuffer<Table>(nullptr)) return nullptr;
  return flatbuffers::GetRoot<Table>(bytes.data());
}

// One pair for each record. decode(): false for bytes that are no such record.
Bytes encode(const SessionRecord& record);
Bytes encode(const InputRecord& record);
Bytes encode(const PictureRecord& record);
Bytes encode(const EstimateRecord& record);
Bytes encode(const AnchorRecord& record);
Bytes encode(const StateRecord& record);
Bytes encode(const TileRecord& record);
Bytes encode(const HealthRecord& record);
Bytes encode(const ThumbnailRecord& record);
Bytes encode(const RecorderRecord& record);
Bytes encode(const EndRecord& record);
Bytes encode(const HintRecord& record);

bool decode(ByteView bytes, SessionRecord& record);
bool decode(ByteView bytes, InputRecord& record);
bool decode(ByteView bytes, PictureRecord& record);
bool decode(ByteView bytes, EstimateRecord& record);
bool decode(ByteView bytes, AnchorRecord& record);
bool decode(ByteView bytes, StateRecord& record);
bool decode(ByteView bytes, TileRecord& record);
bool decode(ByteView bytes, HealthRecord& record);
bool decode(ByteView bytes, ThumbnailRecord& record);
bool decode(ByteView bytes, RecorderRecord& record);
bool decode(ByteView bytes, EndRecord& record);
bool decode(ByteView bytes, HintRecord& record);

}  // namespace nadir::codec
