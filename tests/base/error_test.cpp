#include "base/error.hpp"

#include <gtest/gtest.h>

#include <algorithm>

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
  for (const char* text : {"", "plain", "zwölf m² → \xF0\x9F\x9B\xA9", "⏎"}) EXPECT_EQ(printable(text), text);
}

TEST(Printable, ReplacesEscapeSequences) {
  EXPECT_EQ(printable("a\x1b[2Jb\r\x7f\t"), "a?[2Jb???");
  EXPECT_EQ(printable("\xC2\x9B"
                      "31m"),
            "?31m");  // the one-character form of ESC [
}

constexpr const char* kForged = "valley\ncache.accepted (note)\xE2\x80\xA8nadir: all is well";

TEST(Printable, StaysOnOneLine) {
  EXPECT_EQ(printable("two\nlines"), "two⏎lines");
  EXPECT_EQ(printable("two\r\nlines"), "two?⏎lines");
  EXPECT_EQ(printable(kForged), "valley⏎cache.accepted (note)⏎nadir: all is well");
  EXPECT_EQ(printable("\xE2\x80\xA9"), "⏎");
  EXPECT_EQ(printable(printable(kForged)), printable(kForged));
}

TEST(Printable, LinesOfTheProgramStay) {
  EXPECT_EQ(printable_lines("two\nlines\x1b[2J\xE2\x80\xA8"), "two\nlines?[2J⏎");
}

TEST(Printable, AUrlIsShownWithoutItsCredentials) {
  EXPECT_EQ(printable_url("https://map.example.org/x"), "https://map.example.org/x");
  EXPECT_EQ(printable_url("https://me:sec/r@et@map.example.org:8/x\n"), "https://***@map.example.org:8/x⏎");
  EXPECT_EQ(printable_url("me:secret@host"), "***@host");
}

// "exe.gpj" would be shown where "jpg.exe" is written.
TEST(Printable, KeepsTheDirectionOfText) {
  for (const char* control : {"\xE2\x80\xAA", "\xE2\x80\xAE", "\xE2\x81\xA6", "\xE2\x81\xA9"}) {
    EXPECT_EQ(printable(std::string("a") + control + "b"), "a?b");
  }
  EXPECT_EQ(printable("→ \xE2\x80\x94 \xE2\x81\xA5"), "→ \xE2\x80\x94 \xE2\x81\xA5") << "their neighbours stay";
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

// Quoted text cannot add lines to a finding or an error.
TEST(Printable, ForgedLinesReachNoMessage) {
  const std::string finding =
      to_text({.code = kForged, .where = kForged, .expected = kForged, .found = kForged, .fix = kForged});
  EXPECT_EQ(std::count(finding.begin(), finding.end(), '\n'), 4);
  const std::string error =
      Error({.what = kForged, .where = kForged, .expected = kForged, .found = kForged, .fix = kForged}).what();
  EXPECT_EQ(std::count(error.begin(), error.end(), '\n'), 4);
  EXPECT_EQ(error.find("\ncache.accepted"), std::string::npos);
}

}  // namespace

}  // namespace nadir
