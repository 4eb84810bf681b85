#include "recorder/mcap_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "base/error.hpp"

namespace nadir {

bool MemorySource::read(std::uint64_t offset, std::uint64_t count, Bytes& into) const {
  into.clear();
  if (offset > bytes_.size() || count > bytes_.size() - offset) return false;
  const ByteView piece = bytes_.subspan(static_cast<std::size_t>(offset), static_cast<std::size_t>(count));
  into.assign(piece.begin(), piece.end());
  return true;
}

bool FileSource::read(std::uint64_t offset, std::uint64_t count, Bytes& into) const {
  into.clear();
  if (offset > size() || count > size() - offset) return false;
  into.resize(static_cast<std::size_t>(count));
  bool whole = false;
  try {
    whole = file_.read_at(offset, into);
  } catch (const Error&) {  // the medium fails here: what lies before is read all the same
  }
  if (!whole) into.clear();
  return whole;
}

namespace {

constexpr std::uint64_t kMaxRecord = kMaxChunk + (std::uint64_t{1} << 20);
constexpr std::size_t kMaxFindings = 100;

// What the summary contains, and what was seen on the way to it.
struct Indexes {
  std::vector<McapChunkIndex> seen, indexed;
  std::optional<McapStatistics> statistics;
  std::uint64_t summary_start = 0;
  std::uint32_t data_crc = 0;  // running, over the data section
};

class Reader {
 public:
  Reader(const ByteSource& source, std::string_view where, const McapMessageHandler& handler)
      : source_(source), where_(where), handler_(handler) {}

  McapContents read() {
    contents_.size = source_.size();
    Bytes magic;
    // A recorder that was killed while it began a file leaves less than that.
    const bool begun = contents_.size < kMcapMagic.size();
    if (!source_.read(0, begun ? static_cast<std::size_t>(contents_.size) : kMcapMagic.size(), magic) ||
        !std::equal(magic.begin(), magic.end(), kMcapMagic.begin())) {
      report("recorder.format", Severity::error, "an MCAP file", "different bytes at its beginning");
      return std::move(contents_);
    }
    if (begun) {
      report_truncated();
      return std::move(contents_);
    }
    indexes_.data_crc = crc32_of(magic);
    position_ = contents_.whole_size = kMcapMagic.size();
    while (!contents_.finished && next_record()) contents_.whole_size = position_;
    if (contents_.finished) {
      compare();
    } else if (!broken_) {
      report_truncated();
    }
    return std::move(contents_);
  }

 private:
  void report_truncated() {
    report("recorder.truncated", Severity::warning, "a footer at the end",
           fmt::format("complete records up to byte {} of {}", contents_.whole_size, contents_.size),
           "`nadir recorder recover` writes a finished file with everything that is readable");
  }

  void report(const char* code, Severity severity, std::string expected, std::string found, std::string fix = {}) {
    if (contents_.findings.items().size() >= kMaxFindings) return;
    contents_.findings.add({code, severity, where_, std::move(expected), std::move(found), std::move(fix)});
  }

  // False at the end of what can be read.
  bool next_record() {
    Bytes head, content;
    if (!source_.read(position_, kMcapRecordHead, head)) return false;
    McapCursor cursor(head);
    const auto opcode = cursor.number<std::uint8_t>();
    const auto length = cursor.number<std::uint64_t>();
    if (opcode == 0) return broken("a record", "opcode 0");
    if (length > kMaxRecord && length <= contents_.size - position_) {
      return broken(fmt::format("records of at most {} bytes", kMaxRecord), fmt::format("{} bytes", length));
    }
    if (!source_.read(position_ + kMcapRecordHead, length, content)) return false;
    if (opcode == mcap_op::footer) return footer(content);
    if (!in_summary_ && opcode != mcap_op::data_end) {
      indexes_.data_crc = crc32_of(content, crc32_of(head, indexes_.data_crc));
    }
    record(opcode, content);
    position_ += kMcapRecordHead + length;
    return true;
  }

  bool broken(std::string expected, std::string found) {
    broken_ = true;
    report("recorder.format", Severity::error, std::move(expected), fmt::format("{} at byte {}", found, position_),
           "`nadir recorder recover` keeps everything before that");
    return false;
  }

  void record(std::uint8_t opcode, ByteView content) {
    bool sound = true;
    if (opcode == mcap_op::header) {
      McapCursor in(content);
      contents_.profile = in.text();
      contents_.library = in.text();
      sound = in.ok();
    } else if (opcode == mcap_op::chunk) {
      chunk(content);
    } else if (opcode == mcap_op::message_index) {
      message_index(content);
    } else if (opcode == mcap_op::data_end) {
      data_end(content);
    } else if (opcode == mcap_op::chunk_index) {
      const auto index = read_mcap_chunk_index(content);
      sound = index.has_value();
      if (index) indexes_.indexed.push_back(*index);
    } else if (opcode == mcap_op::statistics) {
      indexes_.statistics = read_mcap_statistics(content);
      sound = indexes_.statistics.has_value();
    } else if (opcode == mcap_op::attachment) {
      ++contents_.attachments;
    } else if (opcode == mcap_op::metadata) {
      ++contents_.metadata;
    } else {
      sound = part(opcode, content);
    }
    if (!sound) damage(opcode);
  }

  // Records that may also be in chunks.
  bool part(std::uint8_t opcode, ByteView content) {
    if (opcode == mcap_op::schema) {
      const auto schema = read_mcap_schema(content);
      if (schema) contents_.schemas.emplace(schema->id, *schema);
      return schema.has_value();
    }
    if (opcode == mcap_op::channel) {
      const auto channel = read_mcap_channel(content);
      if (channel) contents_.channels.emplace(channel->id, *channel);
      return channel.has_value();
    }
    if (opcode != mcap_op::message) return true;  // others may come; readers skip what they do not know
    const auto message = read_mcap_message(content);
    if (!message || !contents_.channels.contains(message->channel_id)) return false;
    ++contents_.messages;
    ++contents_.messages_of[message->channel_id];
    const std::uint64_t at = message->log_time_ns;
    contents_.first_ns = std::min(contents_.first_ns.value_or(at), at);
    contents_.last_ns = std::max(contents_.last_ns.value_or(at), at);
    handler_(contents_, *message);
    return true;
  }

  void damage(std::uint8_t opcode) {
    report("recorder.format", Severity::error, "intact records",
           fmt::format("a damaged record (opcode {}) at byte {}", opcode, position_));
  }

  void chunk(ByteView content) {
    ++contents_.chunks;
    McapCursor in(content);
    McapChunkIndex seen;
    seen.first_ns = in.number<std::uint64_t>();
    seen.last_ns = in.number<std::uint64_t>();
    seen.size = in.number<std::uint64_t>();
    const auto crc = in.number<std::uint32_t>();
    seen.compression = in.text();
    seen.compressed_size = in.number<std::uint64_t>();
    const ByteView packed = in.raw(seen.compressed_size);
    seen.offset = position_;
    seen.length = kMcapRecordHead + content.size();
    indexes_.seen.push_back(seen);
    const std::optional<Bytes> records = in.ok() ? decompress_chunk(seen.compression, packed, seen.size) : std::nullopt;
    if (!records)
      return damaged_chunk("a chunk that decompresses", fmt::format("compression \"{}\"", seen.compression));
    if (crc != 0 && crc32_of(*records) != crc) return damaged_chunk("the chunk's CRC", "another");
    McapCursor parts(*records);
    while (!parts.done()) {
      const auto opcode = parts.number<std::uint8_t>();
      const ByteView piece = parts.raw(parts.number<std::uint64_t>());
      if (!parts.ok()) return damaged_chunk("complete records", "the last one is cut off");
      if (!part(opcode, piece))
        return damaged_chunk("intact records", fmt::format("a damaged one (opcode {})", opcode));
    }
  }

  void damaged_chunk(std::string expected, const std::string& found) {
    ++contents_.damaged_chunks;
    report("recorder.chunk", Severity::error, std::move(expected),
           fmt::format("{} in the chunk at byte {}: it is skipped", found, position_),
           "`nadir recorder recover` keeps the other chunks");
  }

  void message_index(ByteView content) {
    if (indexes_.seen.empty()) return;
    McapChunkIndex& chunk = indexes_.seen.back();
    McapCursor in(content);
    chunk.index[in.number<std::uint16_t>()] = position_;
    chunk.index_length += kMcapRecordHead + content.size();
  }

  void data_end(ByteView content) {
    in_summary_ = true;
    McapCursor in(content);
    const auto crc = in.number<std::uint32_t>();
    if (!in.ok()) return damage(mcap_op::data_end);
    if (crc != 0 && crc != indexes_.data_crc) {
      report("recorder.index", Severity::error, "the checksum of all data", "another");
    }
  }

  bool footer(ByteView content) {
    McapCursor in(content);
    indexes_.summary_start = in.number<std::uint64_t>();
    static_cast<void>(in.number<std::uint64_t>());
    const auto crc = in.number<std::uint32_t>();
    Bytes magic;
    const std::uint64_t end = position_ + kMcapRecordHead + content.size();
    if (!in.ok() || !source_.read(end, kMcapMagic.size(), magic) ||
        !std::equal(magic.begin(), magic.end(), kMcapMagic.begin())) {
      return false;
    }
    contents_.finished = true;
    contents_.whole_size = end + kMcapMagic.size();
    if (!in_summary_) report("recorder.format", Severity::error, "a record DataEnd", "none");
    const std::uint64_t start = indexes_.summary_start == 0 ? position_ : indexes_.summary_start;
    Bytes summary;
    if (crc != 0 && (start > position_ || position_ - start > kMaxRecord ||
                     !source_.read(start, end - 4 - start, summary) || crc32_of(summary) != crc)) {
      report("recorder.index", Severity::error, "the summary's checksum", "another");
    }
    if (contents_.whole_size != contents_.size) {
      report("recorder.format", Severity::warning, "the end of the file after its footer",
             fmt::format("{} more bytes", contents_.size - contents_.whole_size));
    }
    return false;
  }

  void compare() {
    if (indexes_.summary_start == 0) return;
    // A writer may leave either out; what is there has to be right.
    if (!indexes_.indexed.empty() && indexes_.indexed != indexes_.seen) {
      report("recorder.index", Severity::error, fmt::format("an index of the {} chunks", indexes_.seen.size()),
             fmt::format("{} entries that do not match them", indexes_.indexed.size()));
    }
    if (!indexes_.statistics) return;
    const McapStatistics& stated = *indexes_.statistics;
    std::map<std::uint16_t, std::uint64_t> stated_of = stated.messages_of;
    std::erase_if(stated_of, [](const auto& entry) { return entry.second == 0; });
    if (stated.messages != contents_.messages || stated_of != contents_.messages_of ||
        stated.chunks != contents_.chunks) {
      report("recorder.index", Severity::error,
             fmt::format("{} messages in {} chunks, as the statistics say", stated.messages, stated.chunks),
             fmt::format("{} messages in {} chunks", contents_.messages, contents_.chunks));
    }
  }

  const ByteSource& source_;
  std::string where_;
  const McapMessageHandler& handler_;
  McapContents contents_;
  Indexes indexes_;
  std::uint64_t position_ = 0;
  bool in_summary_ = false;
  bool broken_ = false;
};

}  // namespace

McapContents read_mcap(const ByteSource& source, std::string_view where, const McapMessageHandler& handler) {
  return Reader(source, where, handler).read();
}

}  // namespace nadir
