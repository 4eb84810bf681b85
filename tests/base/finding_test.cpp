#include "base/error.hpp"

#include <gtest/gtest.h>


namespace nadir {
namespace {

TEST(Findings, OnlyRefusalsRefuse) {
  Findings findings;
  EXPECT_FALSE(findings.refuses());
  findings.add({.code = "a.note", .severity = Severity::note});
  findings.add({.code = "a.warning", .severity = Severity::warning});
  EXPECT_FALSE(findings.refuses());
  Findings more;
  more.add({.code = "a.bad"});
  findings.add(more);
  EXPECT_TRUE(findings.refuses());
  EXPECT_TRUE(findings.contains("a.bad"));
  EXPECT_FALSE(findings.contains("a.ba"));
}

TEST(Findings, TextSaysEverythingThatIsKnownAndNothingElse) {
  EXPECT_EQ(to_text({.code = "tiles.root", .where = "base.mbtiles", .expected = "aa", .found = "bb", .fix = "rebuild"}),
            "tiles.root (refuse)\n  where:    base.mbtiles\n  expected: aa\n  found:    bb\n  to do:    rebuild");
  EXPECT_EQ(to_text({.code = "x", .severity = Severity::warning}), "x (warning)");
}

TEST(Error, RendersItsParts) {
  EXPECT_STREQ(Error({.what = "cannot read", .where = "a.csv:3"}).what(), "cannot read\n  where:    a.csv:3");
}

}  // namespace
}  // namespace nadir
