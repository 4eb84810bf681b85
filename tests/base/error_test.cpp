#include "base/error.hpp"

#include <gtest/gtest.h>

#include "base/printable.hpp"

namespace nadir {
namespace {

TEST(Findings, OnlyErrorsReject) {
  Findings findings;
  EXPECT_FALSE(findings.has_errors());
  findings.add({.code = "a.note", .severity = Severity::note});
  findings.add({.code = "a.warning", .severity = Severity::warning});
  EXPECT_FALSE(findings.has_errors());
  Findings more;
  more.add({.code = "a.bad"});
  findings.add(more);
  EXPECT_TRUE(findings.has_errors());
  EXPECT_TRUE(findings.contains("a.bad"));
  EXPECT_FALSE(findings.contains("a.ba"));
}

TEST(Findings, TextContainsOnlyKnownFields) {
  EXPECT_EQ(to_text({.code = "tiles.root", .where = "base.mbtiles", .expected = "aa", .found = "bb", .fix = "rebuild"}),
            "tiles.root (error)\n  where:    base.mbtiles\n  expected: aa\n  found:    bb\n  to do:    rebuild");
  EXPECT_EQ(to_text({.code = "x", .severity = Severity::warning}), "x (warning)");
}

TEST(Error, PrintsItsParts) {
  EXPECT_STREQ(Error({.what = "cannot read", .where = "a.csv:3"}).what(), "cannot read\n  where:    a.csv:3");
}

TEST(Printable, KeepsPlainText) {
  for (const char* text : {"", "plain", "zwölf m² → \xF0\x9F\x9B\xA9", "two\nlines"}) EXPECT_EQ(printable(text), text);
}

TEST(Printable, ReplacesEscapeSequences) {
  EXPECT_EQ(printable("a\x1b[2Jb\r\x7f\t"), "a?[2Jb???");
  EXPECT_EQ(printable("\xC2\x9B"
                      "31m"),
            "?31m");  // the one-character form of ESC [
}

TEST(Printable, ReturnsValidUtf8) {
  EXPECT_EQ(printable("\xD7x"), "?x");
  EXPECT_EQ(printable("\xC0\xAF"), "??");            // overlong
  EXPECT_EQ(printable("\xED\xA0\x80"), "???");       // surrogate
  EXPECT_EQ(printable("\xF4\x90\x80\x80"), "????");  // above U+10FFFF
  EXPECT_EQ(printable("\xE2\x82"), "??");            // cut off
}

TEST(Printable, IsAppliedToMessages) {
  EXPECT_EQ(std::string(Error({.what = "w", .found = "\x1b[0m"}).what()).find('\x1b'), std::string::npos);
  EXPECT_EQ(to_text({.code = "c", .found = "\x1b[0m"}).find('\x1b'), std::string::npos);
}

}  // namespace

}  // namespace nadir
