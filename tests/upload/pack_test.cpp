#include "upload/pack.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "upload/sample_pack.hpp"

namespace nadir {
namespace {

PackEntry entry_of(std::uint8_t name, std::uint32_t size) {
  PackEntry entry{{}, size};
  entry.sha256.bytes[0] = name;
  return entry;
}

TEST(Pack, HeadIsWhatTheContractSays) {
  const std::vector<std::string> tiles{"one", std::string(300, 'x')};
  std::vector<PackEntry> entries;
  for (const std::string& tile : tiles) {
    entries.push_back({sha256(as_bytes(tile)), static_cast<std::uint32_t>(tile.size())});
  }
  const std::string whole = test::pack_of(tiles);
  const Bytes head = pack_head(entries);
  EXPECT_EQ(as_text(head), whole.substr(0, head.size()));
  EXPECT_EQ(pack_size(entries), whole.size());
  EXPECT_EQ(head.size(), whole.size() - 303);
}

TEST(Pack, RefusesWhatNoPackMayHold) {
  EXPECT_THROW(pack_size({}), Error);
  const std::vector<std::vector<PackEntry>> wrong{{entry_of(1, 0)},
                                                  {entry_of(1, (1U << 20) + 1)},
                                                  {entry_of(1, 5), entry_of(1, 5)},
                                                  std::vector<PackEntry>(2001, entry_of(1, 1))};
  for (const auto& entries : wrong) {
    EXPECT_THROW(pack_size(entries), Error);
    EXPECT_THROW(pack_head(entries), Error);
  }
  std::vector<PackEntry> nine;
  for (std::uint8_t i = 0; i < 9; ++i) nine.push_back(entry_of(i, 1U << 20));
  EXPECT_THROW(pack_size(nine), Error) << "nine tiles of 1 MiB are more than 8 MiB";
}

TEST(Pack, IsFilledButNeverOverfilled) {
  EXPECT_EQ(entries_of_next_pack({}), 0U);
  EXPECT_EQ(entries_of_next_pack(std::vector{entry_of(1, 10)}), 1U);
  std::vector<PackEntry> entries;
  for (int i = 0; i < 3000; ++i) {
    PackEntry entry = entry_of(static_cast<std::uint8_t>(i), 20'000);
    entry.sha256.bytes[1] = static_cast<std::uint8_t>(i >> 8);
    entries.push_back(entry);
  }
  const std::size_t count = entries_of_next_pack(entries);
  EXPECT_EQ(count, (4U << 20) / 20'036 + 1) << "the first that reaches 4 MiB closes the pack";
  EXPECT_LE(pack_size(std::span(entries).first(count)), kMaxPackSize);
  for (PackEntry& entry : entries) entry.size = 1;
  EXPECT_EQ(entries_of_next_pack(entries), 2000U);
  for (PackEntry& entry : entries) entry.size = 1U << 20;
  EXPECT_EQ(entries_of_next_pack(entries), 4U);
}

}  // namespace
}  // namespace nadir
