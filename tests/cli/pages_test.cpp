// Manual pages and completions, made from what a program declares.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>

#include "base/files.hpp"
#include "cli/completions.hpp"
#include "cli/manual_page.hpp"
#include "cli/program_model.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

class BuildCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "build"; }
  std::string_view summary() const override { return "build a package"; }
  std::string_view details() const override {
    return "Makes it.\n.hidden is no request of roff, 'nor is this; 5\xC2\xB0 and C:\\x stay.\n\n  left   right\n  a   "
           "   b";
  }
  std::string_view examples() const override { return "nadir cache build map.tif --out x"; }
  bool offers_json() const override { return true; }
  void setup(Options& options) override {
    options.value("--out", out_, "PACKAGE", "where it goes").required();
    options.value("--format", format_, "FORMAT", "it's [the] tiles: encoding").one_of({"jpeg", "webp"});
    options.value("--quality", quality_, "N", "of the tiles").between(1, 100);
    options.values("--imagery", imagery_, "FILE", "rasters");
    options.flag("--old-spelling", flag_, "a flag").formerly("--older");
    options.positional("MAP", map_, "the map").required();
  }
  int run(Context&) override { return 0; }

 private:
  std::string out_, format_ = "jpeg", map_;
  std::vector<std::string> imagery_;
  int quality_ = 85;
  bool flag_ = false;
};

class WatchCommand final : public Command {
 public:
  explicit WatchCommand(std::string_view name = "watch") : name_(name) {}
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return name_; }
  std::string_view summary() const override { return "watch it"; }
  void setup(Options& options) override { options.value("--at", at_, "TIME", "when"); }
  int run(Context&) override { return 0; }

 private:
  std::string_view name_;
  std::optional<UtcTime> at_;
};

ProgramModel two_commands() {
  std::vector<std::unique_ptr<Command>> commands;
  commands.push_back(std::make_unique<BuildCommand>());
  commands.push_back(std::make_unique<WatchCommand>());
  return describe_program({"nadir", "a program", "The footer."}, commands);
}

std::string page(const ProgramModel& program, const std::string& name) {
  for (const auto& [file, text] : manual_pages(program)) {
    if (file == name) return text;
  }
  return "no page " + name;
}

TEST(ProgramModel, HasWhatTheCommandsDeclare) {
  const ProgramModel program = two_commands();
  ASSERT_EQ(program.commands.size(), 2U);
  std::vector<std::string> titles;
  for (const OptionDescription& option : program.commands[0].options) titles.push_back(option.title());
  EXPECT_THAT(titles, ElementsAre("--out PACKAGE", "--format FORMAT", "--quality N", "--imagery FILE...",
                                  "--old-spelling", "MAP", "--json", "--quiet", "--help"));
  const OptionDescription& format = program.commands[0].options[1];
  EXPECT_THAT(format.choices, ElementsAre("jpeg", "webp"));
  EXPECT_EQ(format.explanation(), "it's [the] tiles: encoding (jpeg, webp) [jpeg]");
  EXPECT_TRUE(program.commands[0].options[0].free_text);
  EXPECT_FALSE(program.commands[0].options[2].free_text);
  EXPECT_THAT(program.first_words(), ElementsAre("cache", "watch"));
}

TEST(ManualPages, ThereIsOneForTheProgramAndOneForEachCommand) {
  std::vector<std::string> files;
  for (const auto& [file, text] : manual_pages(two_commands())) files.push_back(file);
  EXPECT_THAT(files, ElementsAre("nadir.1", "nadir-cache-build.1", "nadir-watch.1"));
  WatchCommand only("");
  const ProgramModel service = describe_single_command("nadird", only);
  ASSERT_EQ(manual_pages(service).size(), 1U);
  EXPECT_EQ(manual_pages(service)[0].first, "nadird.8");
  EXPECT_THAT(manual_pages(service)[0].second, HasSubstr("\\-\\-version"));
}

TEST(ManualPages, SayWhatHelpSays) {
  const std::string text = page(two_commands(), "nadir-cache-build.1");
  for (const char* part :
       {".TH NADIR\\-CACHE\\-BUILD 1", "nadir\\-cache\\-build \\- build a package", "\\fB\\-\\-out\\fR \\fIPACKAGE\\fR",
        "where it goes", "\\fB\\-\\-json\\fR", "\\fB\\-\\-imagery\\fR \\fIFILE\\fR...",
        "nadir cache build map.tif \\-\\-out x", ".BR nadir (1)"}) {
    EXPECT_THAT(text, HasSubstr(part));
  }
  EXPECT_THAT(text, Not(HasSubstr("--older")));
  EXPECT_THAT(page(two_commands(), "nadir.1"), HasSubstr(".BR nadir\\-cache\\-build (1),"));
}

TEST(ManualPages, TextIsNeitherRequestNorEscape) {
  EXPECT_EQ(roff_text(".x\n'y a.b\\n-5\xC2\xB0 \xE2\x80\xA6"), "\\&.x\n\\&\\(aqy a.b\\en\\-5\\[u00B0] \\[u2026]");
  const std::string text = page(two_commands(), "nadir-cache-build.1");
  EXPECT_THAT(text, HasSubstr("\n\\&.hidden is no request"));
  EXPECT_TRUE(
      std::all_of(text.begin(), text.end(), [](char letter) { return static_cast<unsigned char>(letter) < 0x80; }));
  EXPECT_THAT(text, HasSubstr(".nf\n.RS\n  left   right\n  a      b\n.RE\n.fi"));  // a table keeps its layout
}

TEST(Completions, KnowWordsOptionsAndChoices) {
  const ProgramModel program = two_commands();
  const std::string bash = bash_completion(program), zsh = zsh_completion(program), fish = fish_completion(program);
  for (const std::string& text : {bash, zsh, fish}) {
    for (const char* word :
         {"cache", "build", "watch", "out", "format", "jpeg webp", "quality", "imagery", "old-spelling", "json"}) {
      EXPECT_THAT(text, HasSubstr(word));
    }
    EXPECT_THAT(text, Not(HasSubstr("older")));
  }
  EXPECT_THAT(zsh,
              HasSubstr(R"('--format[it'\''s \[the\] tiles\: encoding (jpeg, webp) \[jpeg\]]:FORMAT:(jpeg webp)')"));
  EXPECT_THAT(fish, HasSubstr(R"(-d 'it\'s [the] tiles: encoding (jpeg, webp) [jpeg]')"));
}

TEST(Pages, AreWrittenWithoutBeingShownInHelp) {
  const test::TemporaryFolder folder;
  std::vector<std::unique_ptr<Command>> commands;
  commands.push_back(std::make_unique<BuildCommand>());
  std::ostringstream out, err;
  const FixedClock clock({0});
  const Environment environment{out, err, clock};
  EXPECT_EQ(run_program({"nadir", "a program", ""}, commands, {"--write-pages", folder.path().string()}, environment),
            0);
  for (const char* file : {"man/nadir.1", "man/nadir-cache-build.1", "completions/bash/nadir", "completions/zsh/_nadir",
                           "completions/fish/nadir.fish"}) {
    EXPECT_FALSE(read_text_file(folder.path() / file).empty()) << file;
  }
  EXPECT_EQ(run_program({"nadir", "a program", ""}, commands, {"--help"}, environment), 0);
  EXPECT_THAT(out.str(), Not(HasSubstr("write-pages")));
  EXPECT_EQ(run_program({"nadir", "a program", ""}, commands, {"--write-pages", "/proc/no"}, environment), 2);
}

}  // namespace
}  // namespace nadir
