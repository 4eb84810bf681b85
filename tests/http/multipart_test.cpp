#include "http/multipart.hpp"

#include <gmock/gmock.h>

namespace nadir {
namespace {

using ::testing::ElementsAre;
using ::testing::Pair;

constexpr const char* kType = "multipart/form-data; boundary=\"a b\"";

std::string part(const std::string& header, const std::string& bytes) {
  return "--a b\r\n" + header + "\r\n\r\n" + bytes + "\r\n";
}

TEST(Multipart, ReadsFieldsAndFiles) {
  const std::string body =
      part("Content-Disposition: form-data; name=\"telemetry\"\r\nContent-Type: Text/CSV; charset=utf-8",
           "frame\r\n1") +
      part("content-disposition: form-data; name=picture; filename=\"a \\\"b\\\".jpg\"", std::string("\0--a b", 6)) +
      "--a b--\r\n";
  const auto parts = parse_multipart(kType, body, 2);
  ASSERT_TRUE(parts);
  ASSERT_EQ(parts->size(), 2U);
  EXPECT_EQ((*parts)[0].name, "telemetry");
  EXPECT_EQ((*parts)[0].content_type, "text/csv");
  EXPECT_EQ((*parts)[0].bytes, "frame\r\n1");
  EXPECT_EQ((*parts)[1].filename, "a \"b\".jpg");
  EXPECT_EQ((*parts)[1].bytes, std::string("\0--a b", 6)) << "a boundary begins a line";
  EXPECT_FALSE(parse_multipart(kType, body, 1)) << "more parts than there may be";
}

TEST(Multipart, RejectsWhatIsNotMadeOfParts) {
  const std::string good = part("Content-Disposition: form-data; name=x", "1") + "--a b--";
  EXPECT_TRUE(parse_multipart(kType, good, 9));
  for (std::size_t length = 0; length < good.size(); ++length) {
    EXPECT_FALSE(parse_multipart(kType, good.substr(0, length), 9)) << "cut after " << length;
  }
  for (const char* type : {"multipart/form-data", "multipart/form-data; boundary=", "text/plain; boundary=\"a b\"",
                           "multipart/form-data; boundary=\"a b"}) {
    EXPECT_FALSE(parse_multipart(type, good, 9)) << type;
  }
  EXPECT_FALSE(parse_multipart("multipart/form-data; boundary=" + std::string(71, 'x'), good, 9));
  for (const char* header : {"X: y", "Content-Disposition: attachment; name=x", "Content-Disposition: form-data",
                             "no colon", "Content-Disposition: form-data; name=\"open"}) {
    EXPECT_FALSE(parse_multipart(kType, part(header, "1") + "--a b--", 9)) << header;
  }
  EXPECT_FALSE(
      parse_multipart(kType, part("Content-Disposition: form-data; name=x\r\nX: " + std::string(9000, 'y'), "1"), 9));
}

TEST(Multipart, ReadsQueries) {
  EXPECT_THAT(*parse_query("/x?name=a%20b%2Fc+d&n=&x=1=2"),
              ElementsAre(Pair("n", ""), Pair("name", "a b/c d"), Pair("x", "1=2")));
  EXPECT_TRUE(parse_query("/x")->empty());
  EXPECT_TRUE(parse_query("/x?")->empty());
  for (const char* target : {"/x?a", "/x?a=%", "/x?a=%2", "/x?a=%zz", "/x?a=1&a=2"}) {
    EXPECT_FALSE(parse_query(target)) << target;
  }
}

TEST(Multipart, SplitsPaths) {
  EXPECT_THAT(*path_parts("/v1/flights/a%20b"), ElementsAre("v1", "flights", "a b"));
  EXPECT_THAT(*path_parts("/%2e%2e"), ElementsAre(".."));
  for (const char* path : {"/", "/v1/", "//x", "v1", "/v1/%f"}) EXPECT_FALSE(path_parts(path)) << path;
}

}  // namespace
}  // namespace nadir
