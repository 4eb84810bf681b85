// A recording as it lies on disk: a folder of segments, or a single file. Read whole, in the order of the segments;
// what is damaged is skipped and said.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "recorder/mcap_reader.hpp"
#include "recorder/segment_list.hpp"

namespace nadir {

// Which sequence numbers of a topic a segment holds.
struct SequenceRange {
  std::uint32_t first = 0, last = 0;
  std::uint64_t missing = 0;  // between them
};

struct SegmentContents {
  Segment segment;
  McapContents mcap;
  std::optional<SessionRecord> session;  // of its first record
  std::map<Topic, std::uint64_t> records;
  std::map<Topic, SequenceRange> sequences;
  std::uint64_t foreign = 0;      // of topics that are not ours
  std::uint64_t undecodable = 0;  // of ours, but no such record
  std::optional<EndRecord> end;   // when it is the last record
};

struct Recorded {
  const SegmentContents& segment;
  std::uint64_t at_ns = 0;
  Record record;
};

using TakeRecord = std::function<void(Recorded recorded)>;

// path: a folder as the recorder writes it, or any MCAP file. Throws Error when there is nothing of the kind.
std::vector<SegmentContents> read_recording(const std::filesystem::path& path, const TakeRecord& take);

// The sessions' ids in the order of their first segments.
std::vector<std::string> sessions_of(const std::vector<SegmentContents>& segments);

// What is wrong with a recording as a whole: damage, missing parts, losses that it tells of, no clean end.
Findings check_recording(const std::vector<SegmentContents>& segments);

}  // namespace nadir
