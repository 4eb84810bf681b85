// --report of cache verify and cache validate: every file contains the findings, and no finding's text can escape its
// cell or element.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "commands/cache/cache_report.hpp"
#include "commands/command_fixture.hpp"
#include "package/package_maker.hpp"
#include "support/process.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

class ReportFiles : public test::CommandTest {
 protected:
  std::string read(const char* name) const { return read_text_file(folder_ / "report" / name); }
  json page_data() const {
    const std::string html = read("report.html"), open = "<script type=\"application/json\" id=\"data\">";
    const auto begin = html.find(open) + open.size();
    return json::parse(html.substr(begin, html.find("</script>", begin) - begin));
  }
  std::size_t cells_that_are(const json& data, const std::string& state) const {
    std::size_t count = 0;
    for (const json& cell : data["map"]["cells"]) count += cell["state"] == state ? 1U : 0U;
    return count;
  }
};

TEST_F(ReportFiles, AnAcceptedPackage) {
  const std::string package = maker_.make(folder_).string();
  write_file_atomic(folder_ / "root.json", sign_root(maker_.root, {&maker_.signer}).json());
  ASSERT_EQ(run({"cache", "verify", package, "--trust", path("root.json"), "--report", path("report")}), 0)
      << out_.str() << err_.str();
  EXPECT_TRUE(json::parse(read("findings.json"))["accepted"].get<bool>());
  EXPECT_NE(read("findings.txt").find("accepted"), std::string::npos);
  EXPECT_EQ(read("findings.csv"), "code,severity,where,expected,found,fix\r\n");
  EXPECT_NE(read("findings.md").find("**Accepted**"), std::string::npos);
  const json data = page_data();
  EXPECT_EQ(data["map"]["gap_m2"], 0);
  EXPECT_GT(cells_that_are(data, "good"), 4U);
  EXPECT_EQ(cells_that_are(data, "good"), data["map"]["cells"].size());
  EXPECT_EQ(data["map"]["sectors"][0]["id"], "village");
  // 53 928 m²: the sector and what of the corridor lies outside of it (gaps_command_test.cpp)
  EXPECT_NEAR(data["map"]["needed_m2"].get<double>(), 53'928, 300);
}

TEST_F(ReportFiles, GapsAndAgeShowOnTheMap) {
  const fs::path package = maker_.make(folder_);
  const std::string tiles = (package / kImageryFile).string();
  folder_.write("mission.yaml", test::mission_yaml({{"stable: 730, active: 90", "stable: 1, active: 1"}}));
  test::sqlite(tiles, "DELETE FROM tiles WHERE rowid = (SELECT max(rowid) FROM tiles WHERE zoom_level = 18)");
  EXPECT_EQ(run({"cache", "validate", tiles, "--mission", path("mission.yaml"), "--report", path("report")}), 1);
  const json data = page_data();
  EXPECT_EQ(cells_that_are(data, "gap"), 1U);
  EXPECT_EQ(cells_that_are(data, "stale"), data["map"]["cells"].size() - 1);
  EXPECT_EQ(data["map"]["gap_count"], 1);
  EXPECT_EQ(data["map"]["gaps"].size(), 1U);
  const json document = json::parse(read("findings.json"));
  EXPECT_FALSE(document["accepted"].get<bool>());
  // Python's csv module reads as many findings as the JSON holds, the same ones.
  const auto rows = test::run_process(
      {"python3", "-c", "import csv,sys;print([r['code'] for r in csv.DictReader(open(sys.argv[1], newline=''))])",
       path("report/findings.csv")});
  std::string expected = "[";
  for (const json& finding : document["findings"]) {
    expected += (expected.size() > 1 ? ", '" : "'") + finding["code"].get<std::string>() + "'";
  }
  EXPECT_EQ(rows.out, expected + "]\n") << rows.err;
}

TEST_F(ReportFiles, APackageThatIsNotTrustedIsNotDrawn) {
  const fs::path package = maker_.make(folder_);
  write_file_atomic(folder_ / "root.json", sign_root(maker_.root, {&maker_.signer}).json());
  fs::remove(package / kSignatureFile);
  EXPECT_EQ(run({"cache", "verify", package.string(), "--trust", path("root.json"), "--report", path("report")}), 1);
  EXPECT_TRUE(page_data()["map"].is_null());
  EXPECT_NE(read("findings.md").find("signature.missing"), std::string::npos);
}

TEST_F(ReportFiles, ReportsAFolderThatCannotBeCreated) {
  const fs::path package = maker_.make(folder_);
  folder_.write("mission.yaml", test::mission_yaml());
  folder_.write("taken", "a file");
  EXPECT_EQ(run({"cache", "validate", (package / kImageryFile).string(), "--mission", path("mission.yaml"), "--report",
                 path("taken")}),
            2);
  EXPECT_NE(err_.str().find("taken"), std::string::npos);
}

std::size_t occurrences(const std::string& text, std::string_view word) {
  std::size_t count = 0;
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + word.size())) {
    ++count;
  }
  return count;
}

TEST(CacheReport, TextFromFilesIsEscaped) {
  CacheReport report;
  report.title = "</title><script>alert(1)</script>";
  report.findings.add({.code = "artifact.unexpected",
                       .where = "</script><img src=x onerror=alert(1)>|\x1b[31m",
                       .expected = "=HYPERLINK(\"http://x\")",
                       .found = "a \"quoted\", | piped\nline"});
  const std::string html = cache_report_html(report);
  EXPECT_EQ(html.find("<script>alert"), std::string::npos);
  // The embedded map library names these in its own code; what files say adds none.
  CacheReport harmless;
  harmless.title = "title";
  const std::string page = cache_report_html(harmless);
  for (const char* word :
       {"<img", "src=\"http", "href=\"http", "url(http", "@import", "fetch(", "XMLHttpRequest", "{{"}) {
    EXPECT_EQ(occurrences(html, word), occurrences(page, word)) << word;
  }
  const std::string csv = findings_csv(report.findings);
  EXPECT_EQ(csv.find('\x1b'), std::string::npos);
  EXPECT_NE(csv.find("\"'=HYPERLINK"), std::string::npos) << "a formula for the spreadsheet";
  EXPECT_NE(csv.find("\"a \"\"quoted\"\", | piped⏎line\""), std::string::npos) << csv;
  const std::string markdown = findings_markdown(report);
  EXPECT_EQ(markdown.find("<img"), std::string::npos);
  EXPECT_NE(markdown.find("\\| piped⏎line"), std::string::npos) << markdown;
}

}  // namespace
}  // namespace nadir
