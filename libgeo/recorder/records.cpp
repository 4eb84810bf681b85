#include "recorder/records.hpp"

#include "fbs/anchor_bfbs_generated.h"
#include "fbs/end_bfbs_generated.h"
#include "fbs/estimate_bfbs_generated.h"
#include "fbs/fix_bfbs_generated.h"
#include "fbs/fix_input_bfbs_generated.h"
#include "fbs/health_bfbs_generated.h"
#include "fbs/hint_bfbs_generated.h"
#include "fbs/input_bfbs_generated.h"
#include "fbs/picture_bfbs_generated.h"
#include "fbs/recorder_event_bfbs_generated.h"
#include "fbs/session_bfbs_generated.h"
#include "fbs/state_change_bfbs_generated.h"
#include "fbs/thumbnail_bfbs_generated.h"
#include "fbs/tile_event_bfbs_generated.h"

namespace nadir {
namespace {

struct TopicFacts {
  std::string_view name;
  std::string_view schema;
  Stream stream;
  ByteView binary_schema;
};

template <typename Schema>
ByteView schema_bytes() {
  return {Schema::data(), Schema::size()};
}

const TopicFacts& facts_of(Topic topic) {
  namespace fbs = recorder;
  static const std::array<TopicFacts, kTopics> all{{
      {"/session", "nadir.recorder.Session", Stream::flight, schema_bytes<fbs::SessionBinarySchema>()},
      {"/input", "nadir.recorder.Input", Stream::flight, schema_bytes<fbs::InputBinarySchema>()},
      {"/picture", "nadir.recorder.Picture", Stream::pictures, schema_bytes<fbs::PictureBinarySchema>()},
      {"/estimate", "nadir.recorder.Estimate", Stream::flight, schema_bytes<fbs::EstimateBinarySchema>()},
      {"/anchor", "nadir.recorder.Anchor", Stream::flight, schema_bytes<fbs::AnchorBinarySchema>()},
      {"/state", "nadir.recorder.StateChange", Stream::flight, schema_bytes<fbs::StateChangeBinarySchema>()},
      {"/tile", "nadir.recorder.TileEvent", Stream::flight, schema_bytes<fbs::TileEventBinarySchema>()},
      {"/health", "nadir.recorder.Health", Stream::flight, schema_bytes<fbs::HealthBinarySchema>()},
      {"/thumbnail", "nadir.recorder.Thumbnail", Stream::thumbnails, schema_bytes<fbs::ThumbnailBinarySchema>()},
      {"/recorder", "nadir.recorder.RecorderEvent", Stream::flight, schema_bytes<fbs::RecorderEventBinarySchema>()},
      {"/end", "nadir.recorder.End", Stream::flight, schema_bytes<fbs::EndBinarySchema>()},
      {"/hint", "nadir.recorder.Hint", Stream::flight, schema_bytes<fbs::HintBinarySchema>()},
      {"/fix", "nadir.recorder.Fix", Stream::flight, schema_bytes<fbs::FixBinarySchema>()},
      {"/fix_input", "nadir.recorder.FixInput", Stream::flight, schema_bytes<fbs::FixInputBinarySchema>()},
  }};
  return all.at(static_cast<std::size_t>(topic));
}

std::uint16_t id_of(Topic topic) { return static_cast<std::uint16_t>(static_cast<int>(topic) + 1); }

}  // namespace

std::string_view name_of(RecorderEventKind kind) {
  switch (kind) {
    case RecorderEventKind::dropped_by_queue: return "dropped_by_queue";
    case RecorderEventKind::dropped_by_disk: return "dropped_by_disk";
    case RecorderEventKind::stopped: return "stopped";
    case RecorderEventKind::resumed: return "resumed";
    case RecorderEventKind::segment_deleted: return "segment_deleted";
  }
  return "stopped";
}

std::string_view name_of(Stream stream) {
  switch (stream) {
    case Stream::flight: return "flight";
    case Stream::pictures: return "pictures";
    case Stream::thumbnails: return "thumbnails";
  }
  return "flight";
}

std::optional<Stream> parse_stream(std::string_view name) {
  for (const Stream stream : kStreams) {
    if (name_of(stream) == name) return stream;
  }
  return std::nullopt;
}

std::string_view name_of(Topic topic) { return facts_of(topic).name; }

std::optional<Topic> parse_topic(std::string_view name) {
  for (std::size_t i = 0; i < kTopics; ++i) {
    if (name_of(static_cast<Topic>(i)) == name) return static_cast<Topic>(i);
  }
  return std::nullopt;
}

Stream stream_of(Topic topic) { return facts_of(topic).stream; }

std::string_view schema_name_of(Topic topic) { return facts_of(topic).schema; }

McapChannel mcap_channel(Topic topic) {
  return {.id = id_of(topic),
          .schema_id = id_of(topic),
          .topic = std::string(name_of(topic)),
          .message_encoding = "flatbuffer",
          .metadata = {}};
}

McapSchema mcap_schema(Topic topic) {
  const TopicFacts& facts = facts_of(topic);
  return {.id = id_of(topic),
          .name = std::string(facts.schema),
          .encoding = "flatbuffer",
          .data = Bytes(facts.binary_schema.begin(), facts.binary_schema.end())};
}

}  // namespace nadir
