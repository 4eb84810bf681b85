#include "base/digest.hpp"

#include <gtest/gtest.h>

#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

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
