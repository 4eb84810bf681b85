// Single MCAP records to bytes and back. Readers return nothing for bytes that are no such record.
#pragma once

#include <optional>

#include "recorder/mcap_bytes.hpp"
#include "recorder/mcap_format.hpp"

namespace nadir {

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

}  // namespace nadir
