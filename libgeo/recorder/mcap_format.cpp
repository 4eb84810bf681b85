#include "recorder/mcap_format.hpp"

#include <lz4frame.h>
#include <zlib.h>
#include <zstd.h>

#include <limits>
#include <memory>

#include "base/error.hpp"

namespace nadir {
namespace {

using Counts = std::map<std::uint16_t, std::uint64_t>;

void append_counts(McapBytes& out, const Counts& counts) {
  out.number(static_cast<std::uint32_t>(counts.size() * 10));
  for (const auto& [id, count] : counts) {
    out.number(id);
    out.number(count);
  }
}

Counts read_counts(McapCursor& in) {
  Counts counts;
  McapCursor pairs = in.sized();
  while (pairs.ok() && !pairs.done()) {
    const auto id = pairs.number<std::uint16_t>();
    counts[id] = pairs.number<std::uint64_t>();
  }
  if (!pairs.ok()) static_cast<void>(in.raw(~std::uint64_t{0}));  // the whole record is none
  return counts;
}

template <typename Record>
std::optional<Record> if_ok(const McapCursor& in, Record record) {
  if (!in.ok()) return std::nullopt;
  return record;
}

}  // namespace

void append(McapBytes& out, const McapSchema& schema) {
  McapBytes content;
  content.number(schema.id);
  content.text(schema.name);
  content.text(schema.encoding);
  content.text(as_text(schema.data));
  out.record(mcap_op::schema, content.bytes());
}

std::optional<McapSchema> read_mcap_schema(ByteView bytes) {
  McapCursor in(bytes);
  McapSchema schema;
  schema.id = in.number<std::uint16_t>();
  schema.name = in.text();
  schema.encoding = in.text();
  const ByteView data = in.raw(in.number<std::uint32_t>());
  schema.data.assign(data.begin(), data.end());
  if (schema.id == 0) return std::nullopt;
  return if_ok(in, std::move(schema));
}

void append(McapBytes& out, const McapChannel& channel) {
  McapBytes pairs;
  for (const auto& [name, value] : channel.metadata) {
    pairs.text(name);
    pairs.text(value);
  }
  McapBytes content;
  content.number(channel.id);
  content.number(channel.schema_id);
  content.text(channel.topic);
  content.text(channel.message_encoding);
  content.text(as_text(pairs.bytes()));
  out.record(mcap_op::channel, content.bytes());
}

std::optional<McapChannel> read_mcap_channel(ByteView bytes) {
  McapCursor in(bytes);
  McapChannel channel;
  channel.id = in.number<std::uint16_t>();
  channel.schema_id = in.number<std::uint16_t>();
  channel.topic = in.text();
  channel.message_encoding = in.text();
  McapCursor pairs = in.sized();
  while (pairs.ok() && !pairs.done()) {
    const std::string name = pairs.text();
    channel.metadata[name] = pairs.text();
  }
  if (!pairs.ok()) return std::nullopt;
  return if_ok(in, std::move(channel));
}

void append(McapBytes& out, const McapMessage& message) {
  out.number(mcap_op::message);
  out.number(static_cast<std::uint64_t>(22 + message.data.size()));
  out.number(message.channel_id);
  out.number(message.sequence);
  out.number(message.log_time_ns);
  out.number(message.publish_time_ns);
  out.raw(message.data);
}

std::optional<McapMessage> read_mcap_message(ByteView bytes) {
  McapCursor in(bytes);
  McapMessage message;
  message.channel_id = in.number<std::uint16_t>();
  message.sequence = in.number<std::uint32_t>();
  message.log_time_ns = in.number<std::uint64_t>();
  message.publish_time_ns = in.number<std::uint64_t>();
  message.data = in.rest();
  return if_ok(in, message);
}

void append(McapBytes& out, const McapChunkIndex& index) {
  McapBytes content;
  content.number(index.first_ns);
  content.number(index.last_ns);
  content.number(index.offset);
  content.number(index.length);
  append_counts(content, index.index);
  content.number(index.index_length);
  content.text(index.compression);
  content.number(index.compressed_size);
  content.number(index.size);
  out.record(mcap_op::chunk_index, content.bytes());
}

std::optional<McapChunkIndex> read_mcap_chunk_index(ByteView bytes) {
  McapCursor in(bytes);
  McapChunkIndex index;
  index.first_ns = in.number<std::uint64_t>();
  index.last_ns = in.number<std::uint64_t>();
  index.offset = in.number<std::uint64_t>();
  index.length = in.number<std::uint64_t>();
  index.index = read_counts(in);
  index.index_length = in.number<std::uint64_t>();
  index.compression = in.text();
  index.compressed_size = in.number<std::uint64_t>();
  index.size = in.number<std::uint64_t>();
  return if_ok(in, std::move(index));
}

void append(McapBytes& out, const McapStatistics& statistics) {
  McapBytes content;
  content.number(statistics.messages);
  content.number(statistics.schemas);
  content.number(statistics.channels);
  content.number(statistics.attachments);
  content.number(statistics.metadata);
  content.number(statistics.chunks);
  content.number(statistics.first_ns);
  content.number(statistics.last_ns);
  append_counts(content, statistics.messages_of);
  out.record(mcap_op::statistics, content.bytes());
}

std::optional<McapStatistics> read_mcap_statistics(ByteView bytes) {
  McapCursor in(bytes);
  McapStatistics statistics;
  statistics.messages = in.number<std::uint64_t>();
  statistics.schemas = in.number<std::uint16_t>();
  statistics.channels = in.number<std::uint32_t>();
  statistics.attachments = in.number<std::uint32_t>();
  statistics.metadata = in.number<std::uint32_t>();
  statistics.chunks = in.number<std::uint32_t>();
  statistics.first_ns = in.number<std::uint64_t>();
  statistics.last_ns = in.number<std::uint64_t>();
  statistics.messages_of = read_counts(in);
  return if_ok(in, std::move(statistics));
}

namespace {

// Damaged bytes may announce any size: memory grows with what is actually decompressed.
constexpr std::size_t kStep = std::size_t{1} << 20;

// pull(target, target_size, done): fills some of the target; returns how much, nothing on damage; sets done at the end.
template <typename Pull>
std::optional<Bytes> gather(std::uint64_t size, const Pull& pull) {
  Bytes out;
  bool done = false;
  while (!done) {
    const std::size_t before = out.size();
    const std::size_t room = static_cast<std::size_t>(std::min<std::uint64_t>(kStep, size - before + 1));
    out.resize(before + room);
    const std::optional<std::size_t> got = pull(out.data() + before, room, done);
    if (!got) return std::nullopt;
    out.resize(before + *got);
    if (out.size() > size || (*got == 0 && !done)) return std::nullopt;
  }
  if (out.size() != size) return std::nullopt;
  return out;
}

std::optional<Bytes> decompress_zstd(ByteView bytes, std::uint64_t size) {
  const std::unique_ptr<ZSTD_DStream, decltype(&ZSTD_freeDStream)> stream(ZSTD_createDStream(), ZSTD_freeDStream);
  ZSTD_DCtx_setParameter(stream.get(), ZSTD_d_windowLogMax, 27);
  ZSTD_inBuffer in{bytes.data(), bytes.size(), 0};
  return gather(size, [&](std::uint8_t* target, std::size_t room, bool& done) -> std::optional<std::size_t> {
    ZSTD_outBuffer out{target, room, 0};
    const std::size_t left = ZSTD_decompressStream(stream.get(), &out, &in);
    if (ZSTD_isError(left) != 0) return std::nullopt;
    done = left == 0 && in.pos == in.size;
    return out.pos;
  });
}

std::optional<Bytes> decompress_lz4(ByteView bytes, std::uint64_t size) {
  LZ4F_dctx* made = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&made, LZ4F_VERSION)) != 0) return std::nullopt;
  const std::unique_ptr<LZ4F_dctx, decltype(&LZ4F_freeDecompressionContext)> context(made,
                                                                                     LZ4F_freeDecompressionContext);
  return gather(size, [&](std::uint8_t* target, std::size_t room, bool& done) -> std::optional<std::size_t> {
    std::size_t written = room, taken = bytes.size();
    const std::size_t left = LZ4F_decompress(context.get(), target, &written, bytes.data(), &taken, nullptr);
    if (LZ4F_isError(left) != 0) return std::nullopt;
    bytes = bytes.subspan(taken);
    done = left == 0 && bytes.empty();
    return written;
  });
}

}  // namespace

std::uint32_t crc32_of(ByteView bytes, std::uint32_t before) {
  return static_cast<std::uint32_t>(crc32_z(before, bytes.data(), bytes.size()));
}

Bytes compress_zstd(ByteView bytes, int level) {
  Bytes out(ZSTD_compressBound(bytes.size()));
  const std::size_t size = ZSTD_compress(out.data(), out.size(), bytes.data(), bytes.size(), level);
  if (ZSTD_isError(size) != 0) throw Error({.what = "cannot compress a chunk", .found = ZSTD_getErrorName(size)});
  out.resize(size);
  return out;
}

std::optional<Bytes> decompress_chunk(std::string_view compression, ByteView bytes, std::uint64_t size) {
  if (size > kMaxChunk) return std::nullopt;
  if (compression == "zstd") return decompress_zstd(bytes, size);
  if (compression == "lz4") return decompress_lz4(bytes, size);
  if (!compression.empty() || bytes.size() != size) return std::nullopt;
  return Bytes(bytes.begin(), bytes.end());
}

}  // namespace nadir
