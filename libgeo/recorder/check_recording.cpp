#include <fmt/format.h>

#include "recorder/recording.hpp"

namespace nadir {
namespace {

// Records of one topic through the segments of a session: what is missing between two of them.
std::uint64_t missing_records(const std::vector<const SegmentContents*>& session, Topic topic) {
  std::uint64_t missing = 0;
  std::optional<std::uint32_t> next;
  for (const SegmentContents* segment : session) {
    const auto range = segment->sequences.find(topic);
    if (range == segment->sequences.end()) continue;
    missing += range->second.missing;
    if (next && range->second.first > *next) missing += range->second.first - *next;
    next = range->second.last + 1;
  }
  return missing;
}

void check_segment(const SegmentContents& segment, Findings& findings) {
  const std::string where = segment.segment.path.string();
  findings.add(segment.mcap.findings);
  if (segment.mcap.damaged_chunks == 0 && !segment.session && segment.mcap.messages != 0) {
    findings.add({"recorder.session", Severity::refuse, where, "a session record", "none: it is not of our recorder"});
  }
  if (segment.undecodable != 0) {
    findings.add({"recorder.payload", Severity::refuse, where, "FlatBuffers of the schemas that the file names",
                  fmt::format("{} records that are none", segment.undecodable)});
  }
}

void check_session(const std::string& id, const std::vector<const SegmentContents*>& segments, Findings& findings) {
  const std::string where = "session " + id;
  const SegmentContents* last = nullptr;
  for (const SegmentContents* segment : segments) {
    if (segment->segment.stream == Stream::flight) last = segment;
  }
  if (last == nullptr || !last->end || !last->end->clean_shutdown) {
    findings.add({"recorder.unclean", Severity::warning, where, "a last record that says clean_shutdown",
                  "a recording that was cut off", "what was recorded before is there"});
  }
  if (last != nullptr && last->end && last->end->dropped != 0) {
    findings.add({"recorder.dropped", Severity::warning, where, "every record",
                  fmt::format("{} that were dropped, as the recorder says", last->end->dropped)});
  }
  for (std::size_t i = 0; i < kTopics; ++i) {
    const auto topic = static_cast<Topic>(i);
    if (topic == Topic::session || stream_of(topic) != Stream::flight) continue;
    const std::uint64_t missing = missing_records(segments, topic);
    if (missing == 0) continue;
    findings.add({"recorder.missing", Severity::warning, where, fmt::format("every record of {}", name_of(topic)),
                  fmt::format("{} missing between others", missing)});
  }
}

}  // namespace

Findings check_recording(const std::vector<SegmentContents>& segments) {
  Findings findings;
  for (const SegmentContents& segment : segments) check_segment(segment, findings);
  if (sessions_of(segments).empty() && !findings.refuses() && !segments.empty()) {
    findings.add({"recorder.session", Severity::refuse, segments.front().segment.path.string(), "a session record",
                  "none: nothing was recorded"});
  }
  for (const std::string& id : sessions_of(segments)) {
    std::vector<const SegmentContents*> session;
    for (const SegmentContents& segment : segments) {
      if (segment.session && segment.session->id == id) session.push_back(&segment);
    }
    check_session(id, session, findings);
  }
  return findings;
}

}  // namespace nadir
