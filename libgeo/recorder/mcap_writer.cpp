#include "recorder/mcap_writer.hpp"

#include <algorithm>

#include "recorder/mcap_format.hpp"

namespace nadir {

McapWriter::McapWriter(McapSink& sink, McapWriterOptions options) : sink_(sink), options_(std::move(options)) {}

void McapWriter::add(const McapSchema& schema) { schemas_.emplace(schema.id, schema); }

void McapWriter::add(const McapChannel& channel) { channels_.emplace(channel.id, channel); }

void McapWriter::define(std::uint16_t id) {
  if (written_channels_.contains(id) || !chunk_channels_.insert(id).second) return;
  const McapChannel& channel = channels_.at(id);
  const auto schema = schemas_.find(channel.schema_id);
  if (schema != schemas_.end() && chunk_schemas_.insert(schema->first).second) append(chunk_, schema->second);
  append(chunk_, channel);
}

// At the beginning of a chunk: what has been written in one chunk only.
void McapWriter::define_again() {
  for (const auto& [id, chunks] : written_schemas_) {
    if (chunks == 1 && chunk_schemas_.insert(id).second) append(chunk_, schemas_.at(id));
  }
  for (const auto& [id, chunks] : written_channels_) {
    if (chunks == 1 && chunk_channels_.insert(id).second) append(chunk_, channels_.at(id));
  }
}

void McapWriter::write(const McapMessage& message) {
  if (position_ == 0 && empty()) {
    for (const auto& [id, channel] : channels_) define(id);
  }
  if (empty()) define_again();
  define(message.channel_id);
  chunk_index_[message.channel_id].emplace_back(message.log_time_ns, chunk_.size());
  append(chunk_, message);
  first_ns_ = empty() ? message.log_time_ns : std::min(first_ns_, message.log_time_ns);
  last_ns_ = empty() ? message.log_time_ns : std::max(last_ns_, message.log_time_ns);
  ++chunk_messages_;
}

bool McapWriter::flush() {
  if (empty()) return true;
  McapChunkIndex index;
  if (!to_sink(chunk_record(index))) return false;
  for (const auto& [channel, entries] : chunk_index_) statistics_.messages_of[channel] += entries.size();
  statistics_.first_ns = chunks_.empty() ? first_ns_ : std::min(statistics_.first_ns, first_ns_);
  statistics_.last_ns = chunks_.empty() ? last_ns_ : std::max(statistics_.last_ns, last_ns_);
  statistics_.messages += chunk_messages_;
  for (const std::uint16_t id : chunk_schemas_) ++written_schemas_[id];
  for (const std::uint16_t id : chunk_channels_) ++written_channels_[id];
  chunks_.push_back(std::move(index));
  static_cast<void>(drop_chunk());
  return true;
}

std::map<std::uint16_t, std::uint64_t> McapWriter::drop_chunk() {
  std::map<std::uint16_t, std::uint64_t> dropped;
  for (const auto& [channel, entries] : chunk_index_) dropped[channel] = entries.size();
  chunk_.clear();
  chunk_schemas_.clear();
  chunk_channels_.clear();
  chunk_index_.clear();
  chunk_messages_ = 0;
  return dropped;
}

// The chunk with its message indexes, and before the first one the beginning of the file.
Bytes McapWriter::chunk_record(McapChunkIndex& index) const {
  McapBytes out;
  if (position_ == 0) {
    out.raw(kMcapMagic);
    McapBytes header;
    header.text(options_.profile);
    header.text(options_.library);
    out.record(mcap_op::header, header.bytes());
  }
  Bytes packed;
  if (options_.zstd_level != 0) packed = compress_zstd(chunk_.bytes(), options_.zstd_level);
  const bool pays = !packed.empty() && packed.size() < chunk_.size();
  const ByteView records = pays ? ByteView(packed) : ByteView(chunk_.bytes());
  index.first_ns = first_ns_;
  index.last_ns = last_ns_;
  index.size = chunk_.size();
  index.compression = pays ? "zstd" : "";
  index.compressed_size = records.size();
  index.offset = position_ + out.size();

  McapBytes head;
  head.number(index.first_ns);
  head.number(index.last_ns);
  head.number(index.size);
  head.number(crc32_of(chunk_.bytes()));
  head.text(index.compression);
  head.number(index.compressed_size);
  out.number(mcap_op::chunk);
  out.number(static_cast<std::uint64_t>(head.size() + records.size()));
  out.raw(head.bytes());
  out.raw(records);
  index.length = position_ + out.size() - index.offset;

  const std::size_t indexes_at = out.size();
  for (const auto& [channel, entries] : chunk_index_) {
    index.index[channel] = position_ + out.size();
    McapBytes content;
    content.number(channel);
    content.number(static_cast<std::uint32_t>(entries.size() * 16));
    for (const auto& [time_ns, offset] : entries) {
      content.number(time_ns);
      content.number(offset);
    }
    out.record(mcap_op::message_index, content.bytes());
  }
  index.index_length = out.size() - indexes_at;
  return out.bytes();
}

bool McapWriter::finish() {
  if (!flush()) return false;
  if (position_ == 0) return true;  // never used
  McapBytes end;
  McapBytes crc;
  crc.number(data_crc_);
  end.record(mcap_op::data_end, crc.bytes());
  const Bytes rest = summary();
  end.raw(rest);
  const std::uint64_t summary_start = position_ + kMcapRecordHead + crc.size();
  McapBytes footer;  // its checksum covers the summary and the footer up to itself
  footer.number(mcap_op::footer);
  footer.number(std::uint64_t{20});
  footer.number(summary_start);
  footer.number(std::uint64_t{0});  // no summary offsets
  footer.number(crc32_of(footer.bytes(), crc32_of(rest)));
  end.raw(footer.bytes());
  end.raw(kMcapMagic);
  return to_sink(end.bytes());
}

Bytes McapWriter::summary() const {
  McapBytes out;
  for (const auto& [id, chunks] : written_schemas_) append(out, schemas_.at(id));
  for (const auto& [id, chunks] : written_channels_) append(out, channels_.at(id));
  McapStatistics statistics = statistics_;
  statistics.schemas = static_cast<std::uint16_t>(written_schemas_.size());
  statistics.channels = static_cast<std::uint32_t>(written_channels_.size());
  statistics.chunks = static_cast<std::uint32_t>(chunks_.size());
  append(out, statistics);
  for (const McapChunkIndex& chunk : chunks_) append(out, chunk);
  return out.bytes();
}

bool McapWriter::to_sink(ByteView bytes) {
  if (!sink_.append(bytes)) return false;
  data_crc_ = crc32_of(bytes, data_crc_);
  position_ += bytes.size();
  return true;
}

}  // namespace nadir
