#include "base/json.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "base/error.hpp"

namespace nadir {
namespace {

TEST(Json, ReadsOneDocument) {
  const auto document = parse_json(R"({"a": [1, 2.5, "x", null, true]})", "t");
  EXPECT_EQ(document["a"][2], "x");
}

TEST(Json, RefusesWhatIsNotExactlyOneDocument) {
  for (const char* bad : {"", " ", "{", "{}{}", "{} x", "{'a': 1}", "{\"a\": 1,}", "[1 2]", "nul", "\"\xff\"",
                          "{\"a\": NaN}", "// comment\n{}", "{\"a\": 01}"}) {
    EXPECT_THROW(parse_json(bad, "t"), Error) << bad;
  }
}

TEST(Json, RefusesDuplicateKeysAtAnyDepth) {
  EXPECT_THROW(parse_json(R"({"a": 1, "a": 2})", "t"), Error);
  EXPECT_THROW(parse_json(R"({"x": [{"a": 1, "\u0061": 2}]})", "t"), Error);
  EXPECT_NO_THROW(parse_json(R"([{"a": 1}, {"a": 2}])", "t"));
}

TEST(Json, RefusesFloatsWhereTheyAreNotAllowed) {
  const JsonLimits whole_numbers{.allow_floats = false};
  EXPECT_NO_THROW(parse_json(R"({"a": -12345678901234})", "t", whole_numbers));
  for (const char* bad : {"[1.0]", "[1e3]", "[99999999999999999999999]"}) {
    EXPECT_THROW(parse_json(bad, "t", whole_numbers), Error) << bad;
  }
}

TEST(Json, LimitsDepth) {
  const auto nested = [](std::size_t levels) { return std::string(levels, '[') + std::string(levels, ']'); };
  EXPECT_NO_THROW(parse_json(nested(16), "t"));
  EXPECT_THROW(parse_json(nested(17), "t"), Error);
  EXPECT_THROW(parse_json(nested(100000), "t"), Error);
}

TEST(Json, NamesTheDocument) {
  try {
    parse_json("{", "manifest.json");
    FAIL() << "accepted";
  } catch (const Error& error) {
    EXPECT_EQ(error.text().where, "manifest.json");
  }
}

}  // namespace
}  // namespace nadir
