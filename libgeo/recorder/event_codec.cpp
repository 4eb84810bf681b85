// What happens beside the frames.
#include "fbs/end_generated.h"
#include "fbs/health_generated.h"
#include "fbs/hint_generated.h"
#include "fbs/recorder_event_generated.h"
#include "fbs/state_change_generated.h"
#include "fbs/thumbnail_generated.h"
#include "fbs/tile_event_generated.h"
#include "recorder/codec_parts.hpp"

namespace nadir::codec {

Bytes encode(const StateRecord& record) {
  FlatBufferBuilder builder;
  return finish(builder,
                fbs::CreateStateChangeDirect(builder, record.from.c_str(), record.to.c_str(), record.reason.c_str()));
}

bool decode(ByteView bytes, StateRecord& record) {
  const auto* told = verified<fbs::StateChange>(bytes);
  if (told == nullptr) return false;
  record = {text(told->from()), text(told->to()), text(told->reason())};
  return true;
}

Bytes encode(const TileRecord& record) {
  FlatBufferBuilder builder;
  return finish(builder, fbs::CreateTileEventDirect(builder, record.key.z, record.key.x, record.key.y,
                                                    record.code.c_str(), record.text.c_str()));
}

bool decode(ByteView bytes, TileRecord& record) {
  const auto* told = verified<fbs::TileEvent>(bytes);
  if (told == nullptr) return false;
  if (told->zoom() < 0 || told->zoom() > kMaxZoom || told->x() < 0 || told->y() < 0) return false;
  record.key = {static_cast<std::uint8_t>(told->zoom()), static_cast<std::uint32_t>(told->x()),
                static_cast<std::uint32_t>(told->y())};
  if (told->x() != record.key.x || told->y() != record.key.y || !record.key.valid()) return false;
  record.code = text(told->code());
  record.text = text(told->text());
  return true;
}

Bytes encode(const HealthRecord& record) {
  FlatBufferBuilder builder;
  std::vector<flatbuffers::Offset<fbs::Measure>> list;
  for (const auto& [name, value] : record.measures) {
    list.push_back(fbs::CreateMeasureDirect(builder, name.c_str(), value));
  }
  const auto measures = builder.CreateVector(list);
  const auto notes = builder.CreateVectorOfStrings(record.notes);
  return finish(builder, fbs::CreateHealth(builder, record.healthy, measures, notes));
}

bool decode(ByteView bytes, HealthRecord& record) {
  const auto* told = verified<fbs::Health>(bytes);
  if (told == nullptr) return false;
  record.healthy = told->healthy();
  if (told->measures() != nullptr) {
    for (const auto* measure : *told->measures()) record.measures.emplace_back(text(measure->name()), measure->value());
  }
  if (told->notes() != nullptr) {
    for (const auto* note : *told->notes()) record.notes.push_back(text(note));
  }
  return true;
}

Bytes encode(const ThumbnailRecord& record) {
  FlatBufferBuilder builder(record.seen.size() + record.map.size() + 256);
  const auto frame = builder.CreateString(record.frame);
  const auto seen = builder.CreateVector(record.seen), map = builder.CreateVector(record.map);
  return finish(builder, fbs::CreateThumbnail(builder, record.index, frame, verdict(record.verdict), seen, map));
}

bool decode(ByteView told_bytes, ThumbnailRecord& record) {
  const auto* told = verified<fbs::Thumbnail>(told_bytes);
  if (told == nullptr) return false;
  record = {told->index(), text(told->frame()), verdict(told->verdict()), bytes(told->seen()), bytes(told->map())};
  return true;
}

Bytes encode(const RecorderRecord& record) {
  FlatBufferBuilder builder;
  const auto kind = static_cast<fbs::RecorderEventKind>(static_cast<std::uint8_t>(record.trouble));
  return finish(builder,
                fbs::CreateRecorderEventDirect(builder, kind, record.topic.c_str(), record.count, record.text.c_str()));
}

bool decode(ByteView bytes, RecorderRecord& record) {
  const auto* told = verified<fbs::RecorderEvent>(bytes);
  if (told == nullptr || told->kind() > fbs::RecorderEventKind::MAX) return false;
  record.trouble = static_cast<RecorderTrouble>(static_cast<std::uint8_t>(told->kind()));
  record.topic = text(told->topic());
  record.count = told->count();
  record.text = text(told->text());
  return true;
}

Bytes encode(const EndRecord& record) {
  FlatBufferBuilder builder;
  return finish(builder, fbs::CreateEndDirect(builder, record.clean_shutdown, record.records, record.dropped,
                                              record.reason.c_str()));
}

bool decode(ByteView bytes, EndRecord& record) {
  const auto* told = verified<fbs::End>(bytes);
  if (told == nullptr) return false;
  record = {told->clean_shutdown(), told->records(), told->dropped(), text(told->reason())};
  return true;
}

Bytes encode(const HintRecord& record) {
  FlatBufferBuilder builder;
  const fbs::LonLat at = place(record.place);
  return finish(builder, fbs::CreateHintDirect(builder, record.before, &at, record.radius_m, record.by.c_str()));
}

bool decode(ByteView bytes, HintRecord& record) {
  const auto* told = verified<fbs::Hint>(bytes);
  if (told == nullptr || told->place() == nullptr) return false;
  record = {told->before(), *place(told->place()), told->radius_m(), text(told->by())};
  return true;
}

}  // namespace nadir::codec
