#include "base/json.hpp"

#include <gtest/gtest.h>

#include <array>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>

namespace nadir {
namespace {

TEST(Json, ReadsOneDocument) {
  const auto document = parse_json(R"({"a": [1, 2.5, "x", null, true]})", "t");
  EXPECT_EQ(document["a"][2], "x");
}

TEST(Json, RejectsAnythingButOneDocument) {
  for (const char* bad : {"", " ", "{", "{}{}", "{} x", "{'a': 1}", "{\"a\": 1,}", "[1 2]", "nul", "\"\xff\"",
                          "{\"a\": NaN}", "// comment\n{}", "{\"a\": 01}"}) {
    EXPECT_THROW(parse_json(bad, "t"), Error) << bad;
  }
}

TEST(Json, RejectsDuplicateKeysAtAnyDepth) {
  EXPECT_THROW(parse_json(R"({"a": 1, "a": 2})", "t"), Error);
  EXPECT_THROW(parse_json(R"({"x": [{"a": 1, "\u0061": 2}]})", "t"), Error);
  EXPECT_NO_THROW(parse_json(R"([{"a": 1}, {"a": 2}])", "t"));
}

TEST(Json, RejectsFloatsWhereTheyAreNotAllowed) {
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

using nlohmann::json;

const JsonReader::Subject kSubject{.name = "file", .what = "cannot accept this", .fix = "write it again"};

ErrorText refused(const std::function<void()>& read) {
  try {
    read();
  } catch (const JsonError& error) {
    return error.text();
  }
  ADD_FAILURE() << "nothing was thrown";
  return {};
}

enum class Colour { red, green };
const char* name_of(Colour colour) { return colour == Colour::red ? "red" : "green"; }

TEST(JsonReader, ReadsMembersOfEachType) {
  const json whole{{"t", "words"},
                   {"n", 1.5},
                   {"w", -3},
                   {"y", true},
                   {"d", std::string(64, 'a')},
                   {"o", {{"i", 7}}},
                   {"c", "green"},
                   {"u", "2030-01-01T00:00:00Z"}};
  const JsonReader in(whole, kSubject);
  EXPECT_EQ(in.text("t"), "words");
  EXPECT_EQ(in.number("n", 1, 2), 1.5);
  EXPECT_EQ(in.number("w", -3, -3), -3) << "an integer is a number";
  EXPECT_EQ(in.integer("w", -3, 3), -3);
  EXPECT_TRUE(in.boolean("y"));
  EXPECT_EQ(in.digest("d").hex(), std::string(64, 'a'));
  EXPECT_EQ(in.object("o").integer("i", 0, 7), 7);
  EXPECT_EQ(in.object("o").where(), "file /o");
  EXPECT_EQ(in.choice("c", std::array{Colour::red, Colour::green}), Colour::green);
  EXPECT_EQ(in.choice("c", {"blue", "green"}), "green");
  EXPECT_EQ(to_rfc3339(in.time("u")), "2030-01-01T00:00:00Z");
  in.expect("t", "words");
  in.finish();
}

TEST(JsonReader, ErrorsStateWhereExpectedAndFound) {
  const json whole{{"o", {{"a/b", {1, 8}}}}};
  const ErrorText text = refused([&] { JsonReader(whole, kSubject).object("o").array("a/b").integer(1, 0, 7); });
  EXPECT_EQ(text.what, "cannot accept this");
  EXPECT_EQ(text.where, "file /o/a~1b/1");
  EXPECT_EQ(text.expected, "an integer from 0 to 7");
  EXPECT_EQ(text.found, "8");
  EXPECT_EQ(text.fix, "write it again");
}

TEST(JsonReader, RejectsMissingAndUnknownMembers) {
  const json list = json::array();
  EXPECT_EQ(refused([&] { JsonReader(list, kSubject); }).expected, "an object");
  const json two{{"a", 1}, {"b", 2}};
  const JsonReader in(two, kSubject);
  EXPECT_EQ(in.integer("a", 1, 1), 1);
  EXPECT_EQ(refused([&] { in.finish(); }).found, "\"b\"");
  EXPECT_NO_THROW(in.finish("b")) << "names with this prefix are for others";
  EXPECT_TRUE(in.has("b"));
  EXPECT_NO_THROW(in.finish());
  EXPECT_EQ(refused([&] { in.value("c"); }).expected, "a member \"c\"");
  EXPECT_EQ(refused([&] { in.object("a"); }).where, "file /a");
  const JsonReader other(two, kSubject);
  EXPECT_EQ(other.keys(), (std::vector<std::string>{"a", "b"}));
  EXPECT_NO_THROW(other.finish());
}

TEST(JsonReader, OptionalMembersAreCheckedWhenPresent) {
  const json whole{{"n", nullptr}, {"t", "x"}};
  const JsonReader in(whole, kSubject);
  EXPECT_EQ(in.optional_number("absent", 0, 1), std::nullopt);
  EXPECT_EQ(in.optional_integer<int>("absent", 0, 1), std::nullopt);
  EXPECT_EQ(in.optional_text("absent"), std::nullopt);
  EXPECT_EQ(in.optional_text("t"), "x");
  EXPECT_EQ(in.optional_boolean("absent"), std::nullopt);
  EXPECT_EQ(in.optional_time("absent"), std::nullopt);
  EXPECT_FALSE(in.optional_object("absent"));
  EXPECT_FALSE(in.optional_array("absent"));
  EXPECT_TRUE(in.is_null("n"));
  refused([&] { in.optional_number("n", 0, 1); });
  refused([&] { in.optional_object("t"); });
  refused([&] { in.is_null("absent"); });
}

TEST(JsonReader, LimitsLengthsOfArraysAndTexts) {
  const json whole{{"a", {1, 2}}, {"t", "xy"}};
  const JsonReader in(whole, kSubject);
  EXPECT_EQ(in.array("a", {.least = 2, .most = 2}).size(), 2U);
  EXPECT_EQ(refused([&] { in.array("a", {.least = 3}); }).expected, "an array of at least 3 elements");
  EXPECT_EQ(refused([&] { in.array("a", {.most = 1}); }).found, "2");
  EXPECT_EQ(refused([&] { in.array("a").integer(2, 0, 9); }).expected, "an element 2");
  EXPECT_EQ(in.text("t", {.least = 1, .most = 2}), "xy");
  EXPECT_EQ(refused([&] { in.text("t", {.least = 3, .most = 4}); }).expected, "text of 3 to 4 bytes");
  refused([&] { in.array("t"); });
}

TEST(JsonReader, RejectsOtherTypesAndValuesOutOfRange) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  for (const json& value : {json(nullptr), json("7"), json(true), json(json::array()), json(nan), json(infinity),
                            json(1e300), json(std::numeric_limits<std::uint64_t>::max()),
                            json(std::numeric_limits<std::int64_t>::min()), json(101), json(-1)}) {
    const json object{{"a", value}};
    const JsonReader in(object, kSubject);
    refused([&] { in.number("a", 0, 100); });
    refused([&] { in.integer("a", 0, 100); });
    refused([&] { in.digest("a"); });
    refused([&] { in.time("a"); });
    refused([&] { in.choice("a", {"b"}); });
    refused([&] { in.choice("a", std::array{Colour::red}); });
    refused([&] { in.expect("a", "b"); });
    if (!value.is_string()) refused([&] { in.text("a"); });
    if (!value.is_boolean()) refused([&] { in.boolean("a"); });
  }
  const json half{{"a", 0.5}};
  refused([&] { JsonReader(half, kSubject).integer("a", 0, 1); });
}

TEST(JsonReader, QuotesHostileTextTruncatedAndEscaped) {
  const std::string hostile = "\xff\x1b" + std::string(1000, 'x');
  const json object{{"a", hostile}, {hostile, 1}};
  const JsonReader in(object, kSubject);
  for (const ErrorText& text :
       {refused([&] { in.integer("a", 0, 1); }), refused([&] { in.finish(); }), refused([&] { in.text(hostile); })}) {
    for (const std::string& part : {text.where, text.found}) {
      EXPECT_LE(part.size(), 120U);
      EXPECT_EQ(part.find('\x1b'), std::string::npos);
      EXPECT_EQ(part.find('\xff'), std::string::npos);
    }
  }
}

// "[json.exception.parse_error.101]" means nothing to a user.
TEST(Json, NamesNoExceptionsOfTheLibrary) {
  for (const char* text : {"{\"a\": nul}", "", "{\"a\": 1e999}", "{\"a\": \"\xff\"}", "[1"}) {
    try {
      parse_json(text, "document");
      ADD_FAILURE() << text;
    } catch (const Error& error) {
      EXPECT_EQ(std::string(error.what()).find("json.exception"), std::string::npos) << error.what();
      EXPECT_FALSE(error.text().found.empty());
    }
  }
  try {
    parse_json("{\"a\": nul}", "document");
  } catch (const Error& error) {
    EXPECT_NE(error.text().found.find("line 1, column 10"), std::string::npos) << error.text().found;
  }
}

}  // namespace
}  // namespace nadir
