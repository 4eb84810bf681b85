#include "recorder/recording.hpp"

#include <algorithm>

#include "base/error.hpp"
#include "recorder/record_codec.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

std::vector<Segment> segments_at(const fs::path& path) {
  std::error_code error;
  if (!fs::is_directory(path, error)) {
    Segment file{.path = path, .number = 0, .stream = Stream::flight, .bytes = FileSource(path).size()};
    for (const Segment& segment : segments_in(path.has_parent_path() ? path.parent_path() : fs::path("."))) {
      if (segment.path.filename() == path.filename()) file = segment;
    }
    file.path = path;
    return {file};
  }
  std::vector<Segment> segments = segments_in(path);
  if (segments.empty()) {
    throw Error({.what = "the folder holds no recording",
                 .where = path,
                 .expected = "files such as 000001.flight.mcap",
                 .fix = "give the folder that the recorder wrote into, or a single MCAP file"});
  }
  return segments;
}

void note_sequence(SegmentContents& segment, Topic topic, std::uint32_t sequence) {
  const auto [at, fresh] = segment.sequences.try_emplace(topic, SequenceRange{sequence, sequence, 0});
  if (fresh) return;
  SequenceRange& range = at->second;
  if (sequence > range.last + 1) range.missing += sequence - range.last - 1;
  range.last = std::max(range.last, sequence);
}

void read_segment(SegmentContents& segment, const TakeRecord& take) {
  const FileSource source(segment.segment.path);
  const auto take_message = [&](const McapContents& contents, const McapMessage& message) {
    const auto topic = parse_topic(contents.channels.at(message.channel_id).topic);
    if (!topic) {
      ++segment.foreign;
      return;
    }
    std::optional<Record> record = decode(*topic, message.data);
    if (!record) {
      ++segment.undecodable;
      return;
    }
    note_sequence(segment, *topic, message.sequence);
    ++segment.records[*topic];
    if (*topic == Topic::session && !segment.session) segment.session = std::get<SessionRecord>(*record);
    segment.end.reset();
    if (*topic == Topic::end) segment.end = std::get<EndRecord>(*record);
    take({segment, message.log_time_ns, std::move(*record)});
  };
  segment.mcap = read_mcap(source, segment.segment.path.string(), take_message);
}

}  // namespace

std::vector<SegmentContents> read_recording(const fs::path& path, const TakeRecord& take) {
  std::vector<SegmentContents> segments;
  for (Segment& segment : segments_at(path)) {
    SegmentContents& contents = segments.emplace_back();
    contents.segment = std::move(segment);
    read_segment(contents, take);
  }
  return segments;
}

std::vector<std::string> sessions_of(const std::vector<SegmentContents>& segments) {
  std::vector<std::string> ids;
  for (const SegmentContents& segment : segments) {
    if (!segment.session) continue;
    if (std::find(ids.begin(), ids.end(), segment.session->id) == ids.end()) ids.push_back(segment.session->id);
  }
  return ids;
}

}  // namespace nadir
