#include "base/json_members.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <nlohmann/json.hpp>

#include "base/error.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr JsonMembers::Complaint kComplaint{"cannot accept this", "write it again"};

ErrorText refused(const std::function<void()>& read) {
  try {
    read();
  } catch (const Error& error) {
    return error.text();
  }
  ADD_FAILURE() << "nothing was thrown";
  return {};
}

TEST(JsonMembers, GivesWhatIsThere) {
  const json whole{{"t", "words"}, {"n", 1.5}, {"w", -3}, {"y", true}, {"d", std::string(64, 'a')}, {"o", {{"i", 7}}}};
  const JsonMembers in(whole, "file", 6, kComplaint);
  EXPECT_EQ(in.text("t"), "words");
  EXPECT_EQ(in.number("n", 1, 2), 1.5);
  EXPECT_EQ(in.number("w", -3, -3), -3) << "a whole number is a number";
  EXPECT_EQ(in.whole("w", -3, 3), -3);
  EXPECT_TRUE(in.yes_or_no("y"));
  EXPECT_EQ(in.digest("d").hex(), std::string(64, 'a'));
  EXPECT_EQ(in.object("o", 1).whole("i", 0, 7), 7);
  EXPECT_EQ(in.object("o", 1).where(), "file: o");
}

TEST(JsonMembers, SaysWhereAndWhatWasExpectedAndFound) {
  const json whole{{"o", {{"i", 8}}}};
  const ErrorText text = refused([&] { JsonMembers(whole, "file", 1, kComplaint).object("o", 1).whole("i", 0, 7); });
  EXPECT_EQ(text.what, "cannot accept this");
  EXPECT_EQ(text.where, "file: o: i");
  EXPECT_EQ(text.expected, "a whole number from 0 to 7");
  EXPECT_EQ(text.found, "8");
  EXPECT_EQ(text.fix, "write it again");
}

TEST(JsonMembers, RefusesWhatIsNoObjectOrHasOtherMembers) {
  EXPECT_EQ(refused([] { JsonMembers(json::array(), "file", 0, kComplaint); }).expected, "an object");
  const json two{{"a", 1}, {"b", 2}};
  EXPECT_EQ(refused([&] { JsonMembers(two, "file", 1, kComplaint); }).expected, "exactly 1 members");
  EXPECT_EQ(refused([&] { JsonMembers(two, "file", 3, kComplaint); }).found, "2");
  const JsonMembers in(two, "file", 2, kComplaint);
  EXPECT_EQ(refused([&] { in.member("c"); }).expected, "this member");
  EXPECT_EQ(refused([&] { in.object("a", 1); }).where, "file: a");
}

TEST(JsonMembers, RefusesOtherTypesAndWhatIsOutOfRange) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  for (const json& value : {json(nullptr), json("7"), json(true), json(json::array()), json(nan), json(infinity),
                            json(1e300), json(std::numeric_limits<std::uint64_t>::max()),
                            json(std::numeric_limits<std::int64_t>::min()), json(101), json(-1)}) {
    const json object{{"a", value}};
    const JsonMembers in(object, "file", 1, kComplaint);
    refused([&] { in.number("a", 0, 100); });
    refused([&] { in.whole("a", 0, 100); });
    refused([&] { in.digest("a"); });
    if (!value.is_string()) refused([&] { in.text("a"); });
    if (!value.is_boolean()) refused([&] { in.yes_or_no("a"); });
  }
  const json half{{"a", 0.5}};
  refused([&] { JsonMembers(half, "file", 1, kComplaint).whole("a", 0, 1); });
}

TEST(JsonMembers, HostileTextIsQuotedShortAndAsValidText) {
  const json object{{"a", "\xff\x1b" + std::string(1000, 'x')}};
  const std::string found = refused([&] { JsonMembers(object, "file", 1, kComplaint).whole("a", 0, 1); }).found;
  EXPECT_LE(found.size(), 80U);
  EXPECT_EQ(found.find('\x1b'), std::string::npos);
  EXPECT_EQ(found.find('\xff'), std::string::npos);
}

}  // namespace
}  // namespace nadir
