#include "recorder/recording.hpp"

#include <unistd.h>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>

#include "base/error.hpp"
#include "recorder/mcap_writer.hpp"
#include "recorder/record_codec.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

bool holds(std::span<const Stream> streams, Stream stream) {
  return std::find(streams.begin(), streams.end(), stream) != streams.end();
}

std::vector<Segment> segments_at(const fs::path& path, std::span<const Stream> streams) {
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
    throw Error({.what = "the folder contains no recording",
                 .where = path,
                 .expected = "files such as 000001.flight.mcap",
                 .fix = "give the folder that the recorder wrote into, or a single MCAP file"});
  }
  std::erase_if(segments, [&](const Segment& segment) { return !holds(streams, segment.stream); });
  return segments;
}

void note_sequence(SegmentContents& segment, Topic topic, std::uint32_t sequence) {
  const auto [at, fresh] = segment.sequences.try_emplace(topic, SequenceRange{sequence, sequence, 0});
  if (fresh) return;
  SequenceRange& range = at->second;
  if (sequence > range.last + 1) range.missing += sequence - range.last - 1;
  range.last = std::max(range.last, sequence);
}

void read_segment(SegmentContents& segment, const RecordHandler& handler) {
  const FileSource source(segment.segment.path);
  const auto on_message = [&](const McapContents& contents, const McapMessage& message) {
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
    handler({segment, message.log_time_ns, std::move(*record)});
  };
  segment.mcap = read_mcap(source, segment.segment.path.string(), on_message);
}

}  // namespace

std::vector<SegmentContents> read_recording(const fs::path& path, const RecordHandler& handler,
                                            std::span<const Stream> streams) {
  std::vector<SegmentContents> segments;
  for (Segment& segment : segments_at(path, streams)) {
    SegmentContents& contents = segments.emplace_back();
    contents.segment = std::move(segment);
    read_segment(contents, handler);
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

std::string chosen_session(const fs::path& recording, const std::optional<std::string>& requested,
                           UnlessRequested otherwise) {
  const std::array flight{Stream::flight};
  const std::vector<std::string> ids = sessions_of(read_recording(
      recording, [](const Recorded&) {}, flight));
  if (ids.empty()) {
    throw UsageError({.what = "the recording has no session",
                      .where = recording,
                      .expected = "a file that begins with one",
                      .fix = "nothing was recorded, or its beginning is damaged: nadir recorder verify tells"});
  }
  if (requested && std::find(ids.begin(), ids.end(), *requested) != ids.end()) return *requested;
  if (!requested && (ids.size() == 1 || otherwise == UnlessRequested::newest)) return ids.back();
  throw UsageError({.what = requested ? "the recording has no such session" : "the session is ambiguous",
                    .where = recording,
                    .expected = fmt::format("--session with one of: {}", fmt::join(ids, ", ")),
                    .found = requested.value_or("none"),
                    .fix = "nadir recorder info lists the sessions"});
}

std::uint64_t missing_records(const std::vector<SegmentContents>& segments, std::string_view session, Topic topic) {
  std::uint64_t missing = 0;
  std::optional<std::uint32_t> next;
  for (const SegmentContents& segment : segments) {
    if (!segment.session || segment.session->id != session) continue;
    const auto range = segment.sequences.find(topic);
    if (range == segment.sequences.end()) continue;
    missing += range->second.missing;
    if (next && range->second.first > *next) missing += range->second.first - *next;
    next = range->second.last + 1;
  }
  return missing;
}

namespace {

void check_segment(const SegmentContents& segment, Findings& findings) {
  const std::string where = segment.segment.path.string();
  findings.add(segment.mcap.findings);
  if (segment.mcap.damaged_chunks == 0 && !segment.session && segment.mcap.messages != 0) {
    findings.add({"recorder.session", Severity::error, where, "a session record", "none: not written by our recorder"});
  }
  if (segment.undecodable != 0) {
    findings.add({"recorder.payload", Severity::error, where, "FlatBuffers of the schemas in the file",
                  fmt::format("{} invalid records", segment.undecodable)});
  }
}

void check_session(const std::string& id, const std::vector<SegmentContents>& segments, Findings& findings) {
  const std::string where = "session " + id;
  const SegmentContents* last = nullptr;
  for (const SegmentContents& segment : segments) {
    const bool ours = segment.session && segment.session->id == id;
    if (ours && segment.segment.stream == Stream::flight) last = &segment;
  }
  if (last == nullptr || !last->end || !last->end->clean_shutdown) {
    findings.add({"recorder.unclean", Severity::warning, where, "a last record with clean_shutdown",
                  "a recording that was cut off", "everything recorded before that is intact"});
  }
  if (last != nullptr && last->end && last->end->dropped != 0) {
    findings.add({"recorder.dropped", Severity::warning, where, "every record",
                  fmt::format("{} dropped, as counted by the recorder", last->end->dropped)});
  }
  for (std::size_t i = 0; i < kTopics; ++i) {
    const auto topic = static_cast<Topic>(i);
    if (topic == Topic::session || stream_of(topic) != Stream::flight) continue;
    const std::uint64_t missing = missing_records(segments, id, topic);
    if (missing == 0) continue;
    findings.add({"recorder.missing", Severity::warning, where, fmt::format("every record of {}", name_of(topic)),
                  fmt::format("{} missing between others", missing)});
  }
}

}  // namespace

Findings check_recording(const std::vector<SegmentContents>& segments) {
  Findings findings;
  for (const SegmentContents& segment : segments) check_segment(segment, findings);
  if (sessions_of(segments).empty() && !findings.has_errors() && !segments.empty()) {
    findings.add({"recorder.session", Severity::error, segments.front().segment.path.string(), "a session record",
                  "none: nothing was recorded"});
  }
  for (const std::string& id : sessions_of(segments)) check_session(id, segments, findings);
  return findings;
}

namespace {

constexpr std::size_t kChunkBytes = std::size_t{1} << 20;

void require(bool written, const SegmentFile& file) {
  if (written) return;
  const ErrorText text{.what = "cannot write", .where = file.path(), .found = system_error_text(file.error())};
  throw Error(text);
}

}  // namespace

McapContents recover_mcap(const fs::path& source, const fs::path& target) {
  const FileSource bytes(source);
  if (fs::exists(target))
    throw Error({.what = "the file already exists", .where = target, .fix = "choose another name"});
  const fs::path staging = target.parent_path() / fmt::format(".{}.{}.staging", target.filename().string(), ::getpid());
  McapContents contents;
  try {
    SegmentFile file(staging, false);
    require(file.ok(), file);
    McapWriter writer(file, {.profile = "nadir", .library = "nadir recorder recover", .zstd_level = 1});
    contents = read_mcap(bytes, source.string(), [&](const McapContents& so_far, const McapMessage& message) {
      const McapChannel& channel = so_far.channels.at(message.channel_id);
      const auto schema = so_far.schemas.find(channel.schema_id);
      if (schema != so_far.schemas.end()) writer.add(schema->second);
      writer.add(channel);
      writer.write(message);
      if (writer.chunk_bytes() >= kChunkBytes) require(writer.flush(), file);
    });
    if (contents.messages != 0) {
      require(writer.finish(), file);
      require(file.sync(), file);
    }
  } catch (...) {
    std::error_code ignored;
    fs::remove(staging, ignored);
    throw;
  }
  if (contents.messages == 0) {
    fs::remove(staging);
  } else {
    fs::rename(staging, target);
  }
  return contents;
}

}  // namespace nadir
