// Adding to a package that is there: killed, interrupted, full, read-only; always the old or the new one.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>

#include "base/error.hpp"
#include "base/files.hpp"
#include "commands/command_fixture.hpp"
#include "package/package_maker.hpp"
#include "package/package_writer.hpp"
#include "support/process.hpp"
#include "support/small_disk.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

class Amended : public test::CommandTest {
 protected:
  Amended() { write_file_atomic(key(), maker_.signer.pem(), 0600); }
  fs::path key() const { return folder_ / "p.key.pem"; }
  void make_both() {  // "plain" and the same one "indexed"
    maker_.make(folder_, "plain");
    fs::copy(folder_ / "plain", folder_ / "indexed", fs::copy_options::recursive);
    ASSERT_EQ(index("indexed"), 0) << err_.str();
  }
  int index(const std::string& package) {
    const std::string path = (folder_ / package).string();
    return run({"cache", "index", path, "--key", key(), "--overlap-percent", "10"});
  }
  test::ProcessResult amend(const std::string& package, int event) {
    return test::run_process(
        {NADIR_KILLED_AMEND, folder_ / package, folder_ / "indexed", key(), std::to_string(event)});
  }
  bool same(const std::string& a, const std::string& b) {
    return test::run_process({"diff", "-r", folder_ / a, folder_ / b}).code == 0;
  }
  std::vector<std::string> names_in(const fs::path& folder) const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder)) names.push_back(entry.path().filename());
    return names;
  }
  // A small note, as anything that a package may get.
  Amendment note() const {
    return {{"note"}, [](const fs::path& folder) {
              fs::create_directories(folder / "note");
              write_file_atomic(folder / "note/note.txt", "words");
              return std::vector{describe_file(folder, "note/note.txt", "note")};
            }};
  }
  AmendedPackage add_note(const fs::path& package, Progress& progress) {
    return amend_package(package, load_package_manifest(package), read_mission(package / kMissionFile), note(),
                         &maker_.signer, progress);
  }
};

// Between any two steps, also when the new package is complete and the names have not been exchanged yet.
TEST_F(Amended, AfterAKillThePackageIsOldOrNewAndTheNextRunWorks) {
  make_both();
  fs::copy(folder_ / "plain", folder_ / "package", fs::copy_options::recursive);
  const auto whole = amend("package", 0);
  ASSERT_EQ(whole.code, 0) << whole.err;
  EXPECT_TRUE(same("package", "indexed"));
  const int events = std::stoi(whole.out);
  ASSERT_GE(events, 4);
  fs::remove_all(folder_ / "package");
  fs::copy(folder_ / "plain", folder_ / "package", fs::copy_options::recursive);
  for (int event = 1; event <= events; ++event) {
    ASSERT_EQ(amend("package", event).code, 128 + SIGKILL) << event;
    EXPECT_TRUE(same("package", "plain")) << event;
  }
  EXPECT_TRUE(fs::exists(folder_ / ".package.amended")) << "the last moment is the one right before the exchange";
  ASSERT_EQ(index("package"), 0) << err_.str();
  EXPECT_TRUE(same("package", "indexed"));
  // Right after the exchange: the old one is still beside it.
  fs::copy(folder_ / "plain", folder_ / ".package.amended", fs::copy_options::recursive);
  ASSERT_EQ(index("package"), 0) << err_.str();
  EXPECT_TRUE(same("package", "indexed"));
  EXPECT_THAT(names_in(folder_.path()), testing::UnorderedElementsAre("plain", "indexed", "package", "p.key.pem"));
}

TEST_F(Amended, AnInterruptionLeavesThePackageUnchanged) {
  const fs::path package = maker_.make(folder_, "plain");
  fs::copy(package, folder_ / "package", fs::copy_options::recursive);
  class Interrupting final : public Progress {
   public:
    explicit Interrupting(int at) : left_(at) {}
    void begin(std::string_view, std::uint64_t, std::string_view) override { count(); }
    void advance(std::uint64_t) override { count(); }
    void end() override {}

   private:
    void count() {
      if (--left_ == 0) throw Interrupted();
    }
    int left_;
  };
  for (const int at : {1, 2, 3}) {
    Interrupting progress(at);
    EXPECT_THROW(add_note(folder_ / "package", progress), Interrupted) << at;
    EXPECT_TRUE(same("package", "plain")) << at;
    EXPECT_THAT(names_in(folder_.path()), testing::UnorderedElementsAre("plain", "package", "p.key.pem"));
  }
}

TEST_F(Amended, AdditionsAreSignedAndReplaceEarlierOnes) {
  const fs::path package = maker_.make(folder_);
  NoProgress progress;
  for (int time = 0; time < 2; ++time) {
    const AmendedPackage amended = add_note(package, progress);
    EXPECT_TRUE(amended.is_signed);
    EXPECT_EQ(amended.added_bytes, 5U);
    EXPECT_TRUE(maker_.verify(package, VerifyDepth::full).findings.empty());
    const Manifest manifest = load_package_manifest(package);
    EXPECT_EQ(std::count_if(manifest.artifacts.begin(), manifest.artifacts.end(),
                            [](const Artifact& artifact) { return artifact.role == "note"; }),
              1);
  }
  fs::remove(package / kSignatureFile);
  const AmendedPackage unsigned_one = amend_package(package, load_package_manifest(package),
                                                    read_mission(package / kMissionFile), note(), nullptr, progress);
  EXPECT_FALSE(unsigned_one.is_signed);
  EXPECT_FALSE(fs::exists(package / kSignatureFile));
}

TEST_F(Amended, AFullDiskLosesNothing) {
  const fs::path small = folder_ / "small";
  test::SmallDisk disk(small, "size=4m");
  if (!disk.mounted()) GTEST_SKIP() << "NOT TESTED: a full disk needs root and a tmpfs to mount";
  maker_.make(folder_, "plain");
  fs::copy(folder_ / "plain", small / "package", fs::copy_options::recursive);
  const Amendment large{{"note"}, [](const fs::path& folder) {
                          write_file_atomic(folder / "note", Bytes(4'000'000, 7));
                          return std::vector{describe_file(folder, "note", "note")};
                        }};
  NoProgress progress;
  const fs::path package = small / "package";
  EXPECT_THROW(amend_package(package, load_package_manifest(package), read_mission(package / kMissionFile), large,
                             &maker_.signer, progress),
               OutOfSpace);
  EXPECT_TRUE(same("small/package", "plain"));
  EXPECT_THAT(names_in(small), testing::ElementsAre("package"));
}

TEST_F(Amended, NamesAFolderThatIsNotAPackage) {
  EXPECT_THROW(load_package_manifest(folder_ / "none"), UsageError);
  folder_.write("p/manifest.json", "{}");
  EXPECT_THROW(load_package_manifest(folder_ / "p"), Error);
}

}  // namespace
}  // namespace nadir
