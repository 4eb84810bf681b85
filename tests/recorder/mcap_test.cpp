#include <gtest/gtest.h>
#include <lz4frame.h>

#include "recorder/mcap_format.hpp"
#include "recorder/mcap_writer.hpp"
#include "recorder/sample_records.hpp"

namespace nadir {
namespace {

// Our writer and our reader against each other and against damage. Other people's readers: independent_test.py.

class MemorySink final : public McapSink {
 public:
  bool append(ByteView piece) override {
    if (full) return false;
    bytes.insert(bytes.end(), piece.begin(), piece.end());
    ends.push_back(bytes.size());
    return true;
  }
  Bytes bytes;
  std::vector<std::size_t> ends;  // after each piece
  bool full = false;
};

void add_topics(McapWriter& writer) {
  for (std::size_t i = 0; i < kTopics; ++i) {
    writer.add(mcap_schema(static_cast<Topic>(i)));
    writer.add(mcap_channel(static_cast<Topic>(i)));
  }
}

void write(McapWriter& writer, const Record& record, std::uint32_t sequence) {
  const Bytes payload = encode(record);
  const std::uint64_t at_ns = 1'000'000'000ULL + sequence;
  writer.write({mcap_channel(topic_of(record)).id, sequence, at_ns, at_ns, payload});
}

// Three chunks with a few records each, finished.
MemorySink small_file(int zstd_level) {
  MemorySink sink;
  McapWriter writer(sink, {.profile = "nadir", .library = "test", .zstd_level = zstd_level});
  writer.add(mcap_schema(Topic::estimate));
  writer.add(mcap_channel(Topic::estimate));
  for (std::uint32_t i = 0; i < 9; ++i) {
    write(writer, test::sample_estimate(i), i);
    if (i % 3 == 2) {
      EXPECT_TRUE(writer.flush());
    }
  }
  EXPECT_TRUE(writer.finish());
  return sink;
}

TEST(Mcap, RoundTrips) {
  for (const int level : {0, 1}) {
    Random random(3);
    const std::vector<Record> records = test::sample_records(random);
    MemorySink sink;
    McapWriter writer(sink, {.profile = "nadir", .library = "test", .zstd_level = level});
    add_topics(writer);
    for (std::uint32_t i = 0; i < 100; ++i) {
      write(writer, records[i % records.size()], i);
      if (i % 30 == 0) {
        ASSERT_TRUE(writer.flush());
      }
    }
    ASSERT_TRUE(writer.finish());
    const test::ReadBack back = test::read_back(MemorySource(sink.bytes));
    EXPECT_TRUE(back.contents.findings.empty());
    EXPECT_TRUE(back.contents.finished);
    EXPECT_EQ(back.contents.whole_size, sink.bytes.size());
    EXPECT_EQ(back.contents.profile, "nadir");
    EXPECT_EQ(back.contents.channels.size(), kTopics);
    ASSERT_EQ(back.records.size(), 100U);
    for (std::size_t i = 0; i < 100; ++i) {
      EXPECT_TRUE(test::same(back.records[i].second, records[i % records.size()]));
    }
  }
}

TEST(Mcap, ATruncatedFileIsReadToItsLastCompleteChunk) {
  const MemorySink sink = small_file(1);
  for (std::size_t cut = 0; cut < sink.bytes.size(); ++cut) {
    const auto back = test::read_back(MemorySource(ByteView(sink.bytes).first(cut)));
    // A chunk counts as soon as its own record is whole; its indexes may be missing.
    std::size_t whole = 0;
    for (std::size_t i = 0; i < 3; ++i) whole += cut >= sink.ends[i] ? 3U : 0U;
    ASSERT_GE(back.records.size(), whole) << "cut at " << cut;
    ASSERT_LE(back.records.size(), whole + 3) << "cut at " << cut;
    ASSERT_FALSE(back.contents.finished);
    ASSERT_FALSE(back.contents.findings.has_errors()) << "cut at " << cut;
    ASSERT_TRUE(back.contents.findings.contains("recorder.truncated")) << "cut at " << cut;
    ASSERT_LE(back.contents.whole_size, cut);
  }
}

TEST(Mcap, DetectsEveryFlippedByte) {
  const MemorySink sink = small_file(0);
  for (std::size_t at = 0; at < sink.bytes.size(); ++at) {
    Bytes bad = sink.bytes;
    bad[at] ^= 0x11;
    const auto back = test::read_back(MemorySource(bad));
    EXPECT_FALSE(back.contents.findings.empty()) << "byte " << at;
  }
}

TEST(Mcap, ADamagedChunkCostsOnlyItself) {
  MemorySink sink = small_file(0);
  sink.bytes[sink.ends[0] + 60] ^= 1;  // in the second chunk
  const auto back = test::read_back(MemorySource(sink.bytes));
  EXPECT_EQ(back.contents.damaged_chunks, 1U);
  EXPECT_TRUE(back.contents.findings.contains("recorder.chunk"));
  ASSERT_EQ(back.records.size(), 6U);
  EXPECT_TRUE(test::same(back.records[3].second, test::sample_estimate(6)));
}

// Where the schemas and channels stand.
TEST(Mcap, ADamagedFirstChunkCostsOnlyItself) {
  MemorySink sink = small_file(0);
  sink.bytes[sink.ends[0] / 2] ^= 1;
  const auto back = test::read_back(MemorySource(sink.bytes));
  EXPECT_EQ(back.contents.damaged_chunks, 1U);
  ASSERT_EQ(back.records.size(), 6U);
  EXPECT_TRUE(test::same(back.records[0].second, test::sample_estimate(3)));
  // Also of a file that was cut off: without its summary.
  sink.bytes.resize(sink.ends[2]);
  EXPECT_EQ(test::read_back(MemorySource(sink.bytes)).records.size(), 6U);
}

TEST(Mcap, RandomDamageNeverCrashes) {
  Random random(17);
  for (const int level : {0, 1}) {
    const MemorySink sink = small_file(level);
    for (int round = 0; round < 1000; ++round) {
      Bytes bad = sink.bytes;
      const int flips = random.integer(1, 8);
      for (int i = 0; i < flips; ++i) {
        const auto at = static_cast<std::size_t>(random.integer(0, static_cast<int>(bad.size()) - 1));
        bad[at] = static_cast<std::uint8_t>(random.integer(0, 255));
      }
      static_cast<void>(test::read_back(MemorySource(bad)));
    }
  }
}

TEST(Mcap, MessagesWithoutChunksAreRead) {
  McapBytes out;
  out.raw(kMcapMagic);
  McapBytes header;
  header.text("");
  header.text("somebody");
  out.record(mcap_op::header, header.bytes());
  append(out, mcap_schema(Topic::state));
  append(out, mcap_channel(Topic::state));
  const Bytes payload = encode(Record(StateRecord{"a", "b", "c"}));
  append(out, McapMessage{mcap_channel(Topic::state).id, 0, 5, 5, payload});
  McapBytes zero;
  zero.number(std::uint32_t{0});
  out.record(mcap_op::data_end, zero.bytes());
  McapBytes footer;
  footer.number(std::uint64_t{0});
  footer.number(std::uint64_t{0});
  footer.number(std::uint32_t{0});
  out.record(mcap_op::footer, footer.bytes());
  out.raw(kMcapMagic);
  const auto back = test::read_back(MemorySource(out.bytes()));
  EXPECT_TRUE(back.contents.findings.empty());
  ASSERT_EQ(back.records.size(), 1U);
  EXPECT_EQ(std::get<StateRecord>(back.records[0].second).to, "b");
}

TEST(Mcap, RefusesOtherBytes) {
  for (const std::string_view text : {"MCAP", "\x89MCAQ", "\x89PNG\r\n\x1a\n and more"}) {
    const auto back = test::read_back(MemorySource(as_bytes(text)));
    EXPECT_TRUE(back.contents.findings.contains("recorder.format"));
    EXPECT_TRUE(back.contents.findings.has_errors());
  }
}

TEST(Mcap, AFullSinkKeepsTheChunkForARetry) {
  MemorySink sink;
  McapWriter writer(sink, {.profile = "nadir", .library = "test", .zstd_level = 1});
  add_topics(writer);
  write(writer, test::sample_estimate(0), 0);
  ASSERT_TRUE(writer.flush());
  write(writer, test::sample_estimate(1), 1);
  sink.full = true;
  EXPECT_FALSE(writer.flush());
  EXPECT_FALSE(writer.empty());
  sink.full = false;
  ASSERT_TRUE(writer.flush());
  write(writer, StateRecord{"a", "b", ""}, 0);
  write(writer, test::sample_estimate(2), 2);
  sink.full = true;
  EXPECT_FALSE(writer.flush());
  const auto dropped = writer.drop_chunk();
  EXPECT_EQ(dropped.at(mcap_channel(Topic::estimate).id), 1U);
  sink.full = false;
  write(writer, StateRecord{"b", "c", ""}, 1);
  ASSERT_TRUE(writer.finish());
  const auto back = test::read_back(MemorySource(sink.bytes));
  EXPECT_TRUE(back.contents.findings.empty());
  EXPECT_EQ(back.of(Topic::estimate).size(), 2U);
  EXPECT_EQ(back.of(Topic::state).size(), 1U);
}

Bytes text(std::size_t size) {
  Bytes bytes;
  while (bytes.size() < size) {
    for (const char c : std::string_view("chunks of a flight, over and over; ")) {
      bytes.push_back(static_cast<std::uint8_t>(c));
    }
  }
  return bytes;
}

Bytes lz4(const Bytes& bytes) {
  Bytes out(LZ4F_compressFrameBound(bytes.size(), nullptr));
  out.resize(LZ4F_compressFrame(out.data(), out.size(), bytes.data(), bytes.size(), nullptr));
  return out;
}

TEST(ChunkCompression, DecompressesEachKind) {
  const Bytes plain = text(3'000'000);
  EXPECT_EQ(decompress_chunk("", plain, plain.size()), plain);
  EXPECT_EQ(decompress_chunk("zstd", compress_zstd(plain, 1), plain.size()), plain);
  EXPECT_EQ(decompress_chunk("lz4", lz4(plain), plain.size()), plain);
}

TEST(ChunkCompression, AnotherSizeOrKindIsRefused) {
  const Bytes plain = text(5000), packed = compress_zstd(plain, 1);
  EXPECT_FALSE(decompress_chunk("zstd", packed, plain.size() - 1));
  EXPECT_FALSE(decompress_chunk("zstd", packed, plain.size() + 1));
  EXPECT_FALSE(decompress_chunk("zstd", packed, kMaxChunk + 1));
  EXPECT_FALSE(decompress_chunk("brotli", packed, plain.size()));
  EXPECT_FALSE(decompress_chunk("", packed, plain.size()));
  EXPECT_FALSE(decompress_chunk("lz4", packed, plain.size()));
}

TEST(ChunkCompression, DamagedBytesAreRefused) {
  const Bytes plain = text(20'000);
  for (const auto& [kind, packed] : {std::pair("zstd", compress_zstd(plain, 1)), std::pair("lz4", lz4(plain))}) {
    for (std::size_t cut = 0; cut < packed.size(); ++cut) {
      EXPECT_FALSE(decompress_chunk(kind, ByteView(packed).first(cut), plain.size())) << kind << " cut at " << cut;
    }
  }
}

// RFC 1952's checksum of "123456789", as every catalogue of CRCs lists it.
TEST(ChunkCompression, TheChecksumIsThatOfZip) {
  EXPECT_EQ(crc32_of(as_bytes("123456789")), 0xCBF43926U);
  EXPECT_EQ(crc32_of(as_bytes("6789"), crc32_of(as_bytes("12345"))), 0xCBF43926U);
}

}  // namespace
}  // namespace nadir
