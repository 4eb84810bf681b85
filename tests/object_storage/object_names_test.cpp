// Names of objects, and the texts that pins and answers are made of.
#include <gtest/gtest.h>

#include <string>

#include "base/error.hpp"
#include "object_storage/object_address.hpp"
#include "object_storage/pinned_object.hpp"

namespace nadir {
namespace {

TEST(ObjectAddress, HasOneSpelling) {
  using Store = ObjectAddress::Store;
  struct Case {
    const char* text;
    ObjectAddress expected;
  };
  const std::string web = "https://host.example:8443/a%20b/map.tif";
  for (const Case& one : {Case{"s3://bucket/a/map.tif", {Store::s3, "s3://bucket/a/map.tif", "bucket", "a/map.tif"}},
                          Case{"/vsis3/bucket/a/map.tif", {Store::s3, "s3://bucket/a/map.tif", "bucket", "a/map.tif"}},
                          Case{"/vsigs/bucket/map.tif", {Store::gs, "gs://bucket/map.tif", "bucket", "map.tif"}},
                          Case{"az://container/map.tif", {Store::az, "az://container/map.tif", "container", "map.tif"}},
                          Case{"/vsicurl/https://host.example:8443/a%20b/map.tif", {Store::web, web, "", ""}},
                          Case{"http://[::1]/map.tif", {Store::web, "http://[::1]/map.tif", "", ""}}}) {
    const ObjectAddress address = parse_object_address(one.text);
    EXPECT_EQ(address, one.expected) << one.text;
    EXPECT_EQ(parse_object_address(address.url), address) << one.text;
    EXPECT_TRUE(is_remote_name(one.text));
  }
  for (const char* local : {"map.tif", "/data/map.tif", "a:b.tif", "./s3/map.tif"}) EXPECT_FALSE(is_remote_name(local));
}

TEST(ObjectAddress, RefusesWhatIsNone) {
  for (const char* text :
       {"", "map.tif", "s3://", "s3://bucket", "s3://bucket/", "s3:///key", "https://", "https://host",
        "https:///map.tif", "ftp://host/map.tif", "file:///map.tif", "/vsizip/a.zip/map.tif",
        "/vsicurl/file:///map.tif", "/vsicurl/map.tif", "s3://bucket/a\nb", "http://host:port/map.tif"}) {
    EXPECT_THROW(parse_object_address(text), UsageError) << text;
  }
  EXPECT_THROW(parse_object_address("s3://bucket/" + std::string(4096, 'a')), UsageError);
}

TEST(ObjectAddress, RefusesCredentialsWithoutRepeatingThem) {
  for (const char* text :
       {"https://user:secret@host/map.tif", "https://secret@host/map.tif", "s3://secret@bucket/map.tif",
        "https://host/map.tif?sig=secret", "s3://bucket/map.tif?X-Amz-Signature=secret", "https://host/map.tif#secret",
        "/vsiaz/container/map.tif?sv=1&sig=secret"}) {
    try {
      parse_object_address(text);
      ADD_FAILURE() << text;
    } catch (const UsageError& error) {
      EXPECT_EQ(std::string(error.what()).find("secret"), std::string::npos) << error.what();
    }
  }
}

TEST(ObjectPin, BlocksAsText) {
  ObjectPin pin{parse_object_address("s3://bucket/key"), 2 * kPinBlock_bytes + 1, {}, kPinBlock_bytes, {}};
  for (const char* const content : {"a", "b", "c"}) pin.blocks.push_back(sha256(as_bytes(content)));
  const std::string text = blocks_text(pin);
  EXPECT_EQ(parse_blocks(text, pin.bytes, pin.block_bytes), pin.blocks);
  EXPECT_EQ(parse_blocks(text, 2 * kPinBlock_bytes, pin.block_bytes), std::nullopt) << "two blocks, not three";
  EXPECT_EQ(parse_blocks(text, 3 * kPinBlock_bytes + 1, pin.block_bytes), std::nullopt) << "four";
  EXPECT_EQ(parse_blocks(text.substr(1), pin.bytes, pin.block_bytes), std::nullopt);
  EXPECT_EQ(parse_blocks("", 0, pin.block_bytes), std::nullopt);
  for (const std::uint64_t size : {0ULL, 1ULL, 1000ULL, 4097ULL, 1ULL << 40}) {
    EXPECT_FALSE(is_block_size(size));
    EXPECT_EQ(parse_blocks(text, pin.bytes, size), std::nullopt);
  }
}

TEST(ObjectAnswer, ContentRange) {
  const auto range = parse_content_range("bytes 10-19/146515");
  ASSERT_TRUE(range);
  EXPECT_EQ(range->first, 10U);
  EXPECT_EQ(range->last, 19U);
  EXPECT_EQ(range->size, 146515U);
  for (const char* text :
       {"", "bytes", "bytes 10-19/*", "bytes */146515", "bytes 19-10/100", "bytes 10-100/100", "bytes -1-19/100",
        "bytes 10-19/100 ", "items 10-19/100", "bytes 10-99999999999999999999/100"}) {
    EXPECT_FALSE(parse_content_range(text)) << text;
  }
}

}  // namespace
}  // namespace nadir
