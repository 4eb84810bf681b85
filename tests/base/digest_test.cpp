#include "base/digest.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "base/random.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

TEST(Sha256, KnownAnswers) {  // FIPS 180-4 examples
  EXPECT_EQ(sha256({}).hex(), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256(as_bytes("abc")).hex(), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(Sha256, AgreesWithSha256sum) {
  const test::TemporaryFolder folder;
  Random random(3);
  for (const std::size_t size : {0U, 1U, 63U, 64U, 65U, 4096U, 3'000'001U}) {
    std::string text(size, '\0');
    for (char& c : text) c = static_cast<char>(random.integer(0, 255));
    const auto file = folder.write("f", text);
    const auto oracle = test::run_shell("sha256sum < " + file.string());
    ASSERT_EQ(oracle.code, 0);
    EXPECT_EQ(sha256_file(file).hex(), oracle.out.substr(0, 64));
    EXPECT_EQ(sha256(as_bytes(text)).hex(), oracle.out.substr(0, 64));
  }
}

TEST(Sha256, IsIndependentOfChunking) {
  Sha256Stream stream;
  stream.update(as_bytes("a"));
  stream.update({});
  stream.update(as_bytes("bc"));
  EXPECT_EQ(stream.finish(), sha256(as_bytes("abc")));
  EXPECT_EQ(stream.finish(), sha256({}));  // starts again
}

TEST(Sha256, AcceptsOneSpellingOfHex) {
  const Sha256 digest = sha256(as_bytes("abc"));
  EXPECT_EQ(Sha256::from_hex(digest.hex()), digest);
  std::string upper = digest.hex();
  upper[0] = 'B';
  EXPECT_EQ(Sha256::from_hex(upper), std::nullopt);
  EXPECT_EQ(Sha256::from_hex(digest.hex() + "0"), std::nullopt);
  EXPECT_EQ(Sha256::from_hex(digest.hex().substr(1)), std::nullopt);
  EXPECT_EQ(Sha256::from_hex(std::string(64, 'g')), std::nullopt);
}

TEST(Sha256, RejectsMissingFiles) { EXPECT_THROW(sha256_file("/nonexistent/file"), Error); }

std::string md5_of(std::initializer_list<std::string_view> pieces) {
  Md5Stream stream;
  for (const std::string_view piece : pieces) stream.update(as_bytes(piece));
  return stream.finish();
}

TEST(Md5, KnownAnswers) {  // RFC 1321
  EXPECT_EQ(md5_of({}), "D41D8CD98F00B204E9800998ECF8427E");
  EXPECT_EQ(md5_of({"message ", "", "digest"}), "F96B697D7CB7938D525A2F31AAF161D0");
}

TEST(Md5, AgreesWithMd5sum) {
  const test::TemporaryFolder folder;
  for (const std::size_t size : {55U, 56U, 64U, 100'001U}) {
    const std::string text(size, 'n');
    const auto oracle = test::run_shell("md5sum < " + folder.write("f", text).string() + " | tr a-f A-F");
    ASSERT_EQ(oracle.code, 0);
    EXPECT_EQ(md5_of({text}), oracle.out.substr(0, 32));
  }
}

}  // namespace

}  // namespace nadir
