#include "base/yaml.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/error.hpp"

namespace nadir {
namespace {

std::string complaint(const std::function<void()>& work) {
  try {
    work();
  } catch (const UsageError& error) {
    return error.what();
  }
  return "";
}

TEST(Yaml, ReadsTypedValues) {
  const YamlNode node = YamlNode::parse("zoom: {min: 15, max: 19}\nname: mini\nlist: [1.5, -2]\n", "m.yaml");
  EXPECT_EQ(node.required("zoom").required("max").integer(), 19);
  EXPECT_EQ(node.required("name").text(), "mini");
  ASSERT_EQ(node.required("list").items().size(), 2U);
  EXPECT_EQ(node.required("list").items()[0].number(), 1.5);
  EXPECT_FALSE(node.optional("nothing").has_value());
}

TEST(Yaml, ErrorsStateThePosition) {
  const YamlNode node = YamlNode::parse("id: x\nzoom:\n  min: many\n", "m.yaml");
  const auto text = complaint([&] { node.required("zoom").required("min").integer(); });
  EXPECT_THAT(text, ::testing::HasSubstr("m.yaml:3:"));
  EXPECT_THAT(text, ::testing::HasSubstr("zoom.min"));
  EXPECT_THAT(text, ::testing::HasSubstr("many"));
  EXPECT_THAT(complaint([&] { node.required("zoom").required("max"); }), ::testing::HasSubstr("max"));
}

TEST(Yaml, RejectsMisspeltKeys) {
  const YamlNode node = YamlNode::parse("id: x\nexpries: 2020-01-01\n", "m.yaml");
  EXPECT_THAT(complaint([&] { node.allow_only({"id", "expires"}); }), ::testing::HasSubstr("expries"));
}

TEST(Yaml, RejectsAliasesAndDuplicateKeys) {
  for (const char* bad : {"a: 1\na: 2\n", "a: &x 1\nb: *x\n", "a: [1, 2\n", "\t- x", "a: 1\n---\nb: 2\n"}) {
    EXPECT_NE(complaint([&] { YamlNode::parse(bad, "m.yaml"); }), "") << bad;
  }
}

TEST(Yaml, RejectsInvalidNumbers) {
  for (const char* bad : {"a: .nan", "a: .inf", "a: 1x", "a: ", "a: [1]", "a: nan"}) {
    EXPECT_NE(complaint([&] { YamlNode::parse(bad, "m").required("a").number(); }), "") << bad;
  }
  EXPECT_NE(complaint([&] { YamlNode::parse("a: 1.5", "m").required("a").integer(); }), "");
}

TEST(Yaml, LimitsDepthAndSize) {
  EXPECT_NE(complaint([] { YamlNode::parse(std::string(5000, '[') + std::string(5000, ']'), "m"); }), "");
  EXPECT_NE(complaint([] { YamlNode::parse("a: " + std::string(2'000'000, 'x'), "m"); }), "");
}

// A parser that compares each key with all before it takes 27 s for a megabyte of keys.
TEST(Yaml, AMyriadOfKeysIsReadAndTheLastOneComparedWithAll) {
  std::string text;
  for (int i = 0; i < 60'000; ++i) text += "key" + std::to_string(i) + ": 1\n";
  EXPECT_TRUE(YamlNode::parse(text, "wide").optional("key59999"));
  try {
    YamlNode::parse(text + "key31: 2\n", "wide");
    ADD_FAILURE() << "accepted";
  } catch (const UsageError& error) {
    EXPECT_EQ(error.text().found, "the key \"key31\" a second time");
    EXPECT_EQ(error.text().where, "wide:60001:1");
  }
}

// A kilobyte of commas is a thousand values of some hundred bytes each.
TEST(Yaml, TheNumberOfValuesIsBounded) {
  std::string text = "a: [";
  for (int i = 0; i < 250'000; ++i) text += "1,";
  try {
    YamlNode::parse(text + "1]", "many");
    ADD_FAILURE() << "accepted";
  } catch (const UsageError& error) {
    EXPECT_EQ(error.text().found, "more than 200000 values");
  }
}

}  // namespace
}  // namespace nadir
