// Writes one MCAP file, chunk by chunk. A chunk goes to the sink in one piece together with its message indexes, so
// that a file which ends anywhere between two calls is whole up to there.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "recorder/mcap_format.hpp"

namespace nadir {

// Where a file's bytes go. append() returns false, and the file keeps what it had, when there is no room.
class McapSink {
 public:
  virtual ~McapSink() = default;
  virtual bool append(ByteView bytes) = 0;
};

struct McapWriterOptions {
  std::string profile;
  std::string library;
  int zstd_level = 1;  // 0: chunks are not compressed
};

class McapWriter {
 public:
  // Nothing is written before the first flush(). The sink must outlive the writer.
  McapWriter(McapSink& sink, McapWriterOptions options);

  // What is added before the first message goes into the first chunk, everything else into the chunk in which a channel
  // is used first; and again into the next chunk, so that a damaged chunk does not make others unreadable. Adding one
  // twice changes nothing.
  void add(const McapSchema& schema);
  void add(const McapChannel& channel);

  // Into the chunk that is being filled. The channel must have been added.
  void write(const McapMessage& message);

  bool empty() const { return chunk_messages_ == 0; }
  std::size_t chunk_bytes() const { return chunk_.size(); }
  std::uint64_t messages() const { return statistics_.messages; }  // on the sink

  // The chunk to the sink. False when the sink refuses: the chunk is kept, to be tried again or dropped.
  bool flush();
  // The chunk's messages by channel, which are gone then.
  std::map<std::uint16_t, std::uint64_t> drop_chunk();

  // Summary and footer. False when the sink refuses; the file is then like one that was cut off.
  bool finish();

 private:
  void define(std::uint16_t channel);
  void define_again();
  Bytes chunk_record(McapChunkIndex& index) const;
  Bytes summary() const;
  bool to_sink(ByteView bytes);

  McapSink& sink_;
  McapWriterOptions options_;
  std::map<std::uint16_t, McapSchema> schemas_;
  std::map<std::uint16_t, McapChannel> channels_;
  std::map<std::uint16_t, int> written_schemas_, written_channels_;  // in how many written chunks they are

  McapBytes chunk_;
  std::set<std::uint16_t> chunk_schemas_, chunk_channels_;                                     // defined in this chunk
  std::map<std::uint16_t, std::vector<std::pair<std::uint64_t, std::uint64_t>>> chunk_index_;  // time, offset
  std::uint64_t chunk_messages_ = 0, first_ns_ = 0, last_ns_ = 0;

  std::vector<McapChunkIndex> chunks_;
  McapStatistics statistics_;
  std::uint64_t position_ = 0;  // on the sink
  std::uint32_t data_crc_ = 0;
};

}  // namespace nadir
