// What MCAP files are made of (https://mcap.dev/spec, version 0): the records that our writer and reader know.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>

#include "base/bytes.hpp"

namespace nadir {

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

}  // namespace nadir
