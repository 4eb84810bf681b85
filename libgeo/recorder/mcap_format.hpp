// The MCAP container (https://mcap.dev/spec, version 0): the records that our writer and reader know, as bytes and
// back, and the compression and checksum of chunks.
//
// Numbers are little-endian; texts, maps and arrays are preceded by their length in bytes (32 bits). A record is an
// opcode, a length of 64 bits and its content.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "base/bytes.hpp"

namespace nadir {

class McapBytes {
 public:
  template <typename Number>
  void number(Number value) {
    for (std::size_t i = 0; i < sizeof(Number); ++i) {
      bytes_.push_back(static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (8 * i)));
    }
  }
  void raw(ByteView bytes) { bytes_.insert(bytes_.end(), bytes.begin(), bytes.end()); }
  void text(std::string_view text) {
    number(static_cast<std::uint32_t>(text.size()));
    raw(as_bytes(text));
  }
  // A record around its content.
  void record(std::uint8_t opcode, ByteView content) {
    number(opcode);
    number(static_cast<std::uint64_t>(content.size()));
    raw(content);
  }

  const Bytes& bytes() const { return bytes_; }
  std::size_t size() const { return bytes_.size(); }
  bool empty() const { return bytes_.empty(); }
  void clear() { bytes_.clear(); }

 private:
  Bytes bytes_;
};

// Reads from the front. Missing bytes read as zero and make ok() false for good: check once, at the end.
class McapCursor {
 public:
  explicit McapCursor(ByteView bytes) : left_(bytes) {}

  template <typename Number>
  Number number() {
    std::uint64_t value = 0;
    const ByteView bytes = raw(sizeof(Number));
    for (std::size_t i = 0; i < bytes.size(); ++i) value |= static_cast<std::uint64_t>(bytes[i]) << (8 * i);
    return static_cast<Number>(value);
  }
  ByteView raw(std::uint64_t size) {
    if (size > left_.size()) {
      ok_ = false;
      left_ = {};
      return {};
    }
    const ByteView bytes = left_.first(static_cast<std::size_t>(size));
    left_ = left_.subspan(static_cast<std::size_t>(size));
    return bytes;
  }
  std::string text() { return std::string(as_text(raw(number<std::uint32_t>()))); }
  // The content of a map or an array, which is preceded by its length in bytes.
  McapCursor sized() {
    McapCursor inner(raw(number<std::uint32_t>()));
    if (!ok_) inner.ok_ = false;
    return inner;
  }

  bool ok() const { return ok_; }
  bool done() const { return left_.empty(); }
  ByteView rest() { return raw(left_.size()); }

 private:
  ByteView left_;
  bool ok_ = true;
};

inline constexpr std::array<std::uint8_t, 8> kMcapMagic{0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'};
inline constexpr std::size_t kMcapRecordHead = 9;  // opcode and length

namespace mcap_op {
inline constexpr std::uint8_t header = 0x01, footer = 0x02, schema = 0x03, channel = 0x04, message = 0x05, chunk = 0x06,
                              message_index = 0x07, chunk_index = 0x08, attachment = 0x09, attachment_index = 0x0A,
                              statistics = 0x0B, metadata = 0x0C, metadata_index = 0x0D, summary_offset = 0x0E,
                              data_end = 0x0F;
}  // namespace mcap_op

struct McapSchema {
  std::uint16_t id = 0;  // never 0 in a file
  std::string name;
  std::string encoding;
  Bytes data;

  bool operator==(const McapSchema&) const = default;
};

struct McapChannel {
  std::uint16_t id = 0;
  std::uint16_t schema_id = 0;  // 0: none
  std::string topic;
  std::string message_encoding;
  std::map<std::string, std::string> metadata;

  bool operator==(const McapChannel&) const = default;
};

struct McapMessage {
  std::uint16_t channel_id = 0;
  std::uint32_t sequence = 0;
  std::uint64_t log_time_ns = 0;
  std::uint64_t publish_time_ns = 0;
  ByteView data;  // valid while it is handed over
};

struct McapChunkIndex {
  std::uint64_t first_ns = 0, last_ns = 0;
  std::uint64_t offset = 0, length = 0;          // of the chunk record, its head included
  std::map<std::uint16_t, std::uint64_t> index;  // channel: offset of its message index
  std::uint64_t index_length = 0;
  std::string compression;
  std::uint64_t compressed_size = 0, size = 0;

  bool operator==(const McapChunkIndex&) const = default;
};

struct McapStatistics {
  std::uint64_t messages = 0;
  std::uint16_t schemas = 0;
  std::uint32_t channels = 0, attachments = 0, metadata = 0, chunks = 0;
  std::uint64_t first_ns = 0, last_ns = 0;
  std::map<std::uint16_t, std::uint64_t> messages_of;  // by channel

  bool operator==(const McapStatistics&) const = default;
};

void append(McapBytes& out, const McapSchema& schema);
void append(McapBytes& out, const McapChannel& channel);
void append(McapBytes& out, const McapMessage& message);
void append(McapBytes& out, const McapChunkIndex& index);
void append(McapBytes& out, const McapStatistics& statistics);

// content: of the record, without its head.
std::optional<McapSchema> read_mcap_schema(ByteView content);
std::optional<McapChannel> read_mcap_channel(ByteView content);
std::optional<McapMessage> read_mcap_message(ByteView content);
std::optional<McapChunkIndex> read_mcap_chunk_index(ByteView content);
std::optional<McapStatistics> read_mcap_statistics(ByteView content);

// The largest decompressed chunk that is read.
inline constexpr std::uint64_t kMaxChunk = std::uint64_t{256} << 20;

// The CRC of zlib and of zip files (polynomial 0xEDB88320), continued from `before`.
std::uint32_t crc32_of(ByteView bytes, std::uint32_t before = 0);

Bytes compress_zstd(ByteView bytes, int level);

// size: the decompressed size according to the chunk. Nothing for damaged bytes, another size, an unknown compression
// or a size above the limit.
std::optional<Bytes> decompress_chunk(std::string_view compression, ByteView bytes, std::uint64_t size);

}  // namespace nadir
