// A recording on disk: a folder of segments or a single MCAP file. It is read completely, in the order of the segments;
// damaged parts are skipped and reported. recover_mcap() makes a finished file of what can be read.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "recorder/mcap_reader.hpp"
#include "recorder/segments.hpp"

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
  std::uint64_t undecodable = 0;  // of ours, but invalid
  std::optional<EndRecord> end;   // when it is the last record
};

struct Recorded {
  const SegmentContents& segment;
  std::uint64_t at_ns = 0;
  Record record;
};

using RecordHandler = std::function<void(Recorded recorded)>;

// path: a folder as the recorder writes it, or any MCAP file. streams: of a folder, those that are read. Throws Error
// when there is nothing of the kind.
std::vector<SegmentContents> read_recording(const std::filesystem::path& path, const RecordHandler& handler,
                                            std::span<const Stream> streams = kStreams);

// The sessions' ids in the order of their first segments.
std::vector<std::string> sessions_of(const std::vector<SegmentContents>& segments);

enum class UnlessRequested { only, newest };

// The session to read: `requested`; without that the only one, or the newest. Throws UsageError when there is no such
// one, or several where one alone will do.
std::string chosen_session(const std::filesystem::path& recording, const std::optional<std::string>& requested,
                           UnlessRequested otherwise = UnlessRequested::only);

// How many records of a topic a session lost between the others: gaps in their sequence numbers.
std::uint64_t missing_records(const std::vector<SegmentContents>& segments, std::string_view session, Topic topic);

// Findings about a recording as a whole: damage, missing parts, recorded losses, no clean end.
Findings check_recording(const std::vector<SegmentContents>& segments);

// Every message that is readable, with its schema and channel, its times and its number. Atomic: `target` appears when
// it is whole. Returns what was in the source; attachments and metadata are counted there but not carried over.
McapContents recover_mcap(const std::filesystem::path& source, const std::filesystem::path& target);

}  // namespace nadir
