// Reads any MCAP file from its front to its last whole record: chunked or not, compressed or not, with a summary or cut
// off anywhere. The index is not needed for that, and not believed: what it says is compared with what is there.
//
// Bytes are not trusted. Damage is a finding; a chunk that is damaged is skipped and the next one read.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "base/error.hpp"
#include "recorder/byte_source.hpp"
#include "recorder/mcap_format.hpp"

namespace nadir {

// What is in a file apart from its messages.
struct McapContents {
  std::string profile, library;
  std::uint64_t size = 0;        // bytes
  std::uint64_t whole_size = 0;  // up to the end of the last whole record
  bool finished = false;         // with footer and final magic
  std::map<std::uint16_t, McapSchema> schemas;
  std::map<std::uint16_t, McapChannel> channels;
  std::map<std::uint16_t, std::uint64_t> messages_of;  // read, by channel
  std::uint64_t messages = 0;
  std::uint64_t chunks = 0, damaged_chunks = 0;
  std::uint64_t attachments = 0, metadata = 0;
  std::optional<std::uint64_t> first_ns, last_ns;
  Findings findings;  // recorder.format, recorder.truncated, recorder.chunk, recorder.index
};

// Called for each message in the order of the file. The channel, and its schema if it has one, lie in `contents`.
using McapTake = std::function<void(const McapContents& contents, const McapMessage& message)>;

// where: names the file in findings.
McapContents read_mcap(const ByteSource& source, std::string_view where, const McapTake& take);

}  // namespace nadir
