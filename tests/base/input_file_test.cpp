#include "base/input_file.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>

#include "base/error.hpp"
#include "base/files.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

std::string text_of(const InputFile& file) { return std::string(as_text(file.read(1 << 20))); }

template <typename Work>
ErrorText refusal_of(const Work& work) {
  try {
    work();
  } catch (const Error& error) {
    return error.text();
  }
  ADD_FAILURE() << "not refused";
  return {.what = ""};
}

class InputFiles : public ::testing::Test {
 protected:
  test::TemporaryFolder folder_;
};

// Without O_NONBLOCK each of these waits for a writer until the test is ended from outside.
TEST_F(InputFiles, APipeInPlaceOfAFileIsRefusedAndNotWaitedFor) {
  const fs::path pipe = folder_ / "mission.yaml";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_EQ(refusal_of([&] { InputFile{pipe}; }).found, "a pipe");
  EXPECT_EQ(refusal_of([&] { read_file(pipe); }).found, "a pipe");
  EXPECT_EQ(refusal_of([&] { sha256_file(pipe); }).found, "a pipe");
  EXPECT_EQ(refusal_of([&] { Directory(folder_.path()).open("mission.yaml"); }).found, "a pipe");
  EXPECT_EQ(refusal_of([&] { InputFile{"/dev/zero"}; }).found, "a device");
  EXPECT_EQ(refusal_of([&] { InputFile{folder_.path()}; }).found, "a folder");
}

TEST_F(InputFiles, AnOpenFileStaysTheOneThatWasOpened) {
  const fs::path path = folder_.write("mission.yaml", "the signed one");
  const InputFile file(path);
  const InputFile again = file.duplicate();
  folder_.write("other", "another one");
  fs::rename(folder_ / "other", path);
  EXPECT_EQ(text_of(file), "the signed one");
  EXPECT_EQ(text_of(again), "the signed one");
  EXPECT_EQ(file.sha256(), sha256(as_bytes("the signed one")));
  EXPECT_EQ(text_of(InputFile(path)), "another one");
}

TEST_F(InputFiles, ReadsAreWholeOrRefused) {
  const InputFile file(folder_.write("file", "0123456789"));
  Bytes four(4);
  EXPECT_TRUE(file.read_at(6, four));
  EXPECT_EQ(as_text(four), "6789");
  EXPECT_FALSE(file.read_at(7, four));
  const ErrorText refused = refusal_of([&] { file.read(9); });
  EXPECT_EQ(refused.expected, "at most 9 bytes");
  EXPECT_EQ(refused.found, "10 bytes");
}

TEST_F(InputFiles, ErrorsNameWhatIsWrongWithAPath) {
  const ErrorText missing = refusal_of([&] { InputFile{folder_ / "none"}; });
  EXPECT_EQ(missing.found, "No such file or directory");
  const ErrorText too_long = refusal_of([&] { InputFile{folder_ / std::string(5000, 'a')}; });
  EXPECT_EQ(too_long.found, "File name too long");
  EXPECT_NE(too_long.fix.find("shorter path"), std::string::npos) << too_long.fix;
  EXPECT_EQ(refusal_of([&] { Directory{folder_ / "none"}; }).what, "cannot open the folder");
}

TEST_F(InputFiles, AFolderStaysTheOneThatItsPathNamedOnce) {
  fs::create_directories(folder_ / "one/mission");
  fs::create_directories(folder_ / "two/mission");
  folder_.write("one/mission/mission.yaml", "verified");
  folder_.write("two/mission/mission.yaml", "swapped");
  fs::create_directory_symlink(folder_ / "one", folder_ / "current");
  const Directory current(folder_ / "current");
  fs::remove(folder_ / "current");
  fs::create_directory_symlink(folder_ / "two", folder_ / "current");
  EXPECT_EQ(text_of(current.open("mission/mission.yaml")), "verified");
  fs::rename(folder_ / "one", folder_ / "moved");
  EXPECT_EQ(text_of(current.open("mission/mission.yaml")), "verified");
}

TEST_F(InputFiles, NothingLeadsOutOfAFolder) {
  fs::create_directories(folder_ / "package/inside");
  folder_.write("secret", "outside");
  folder_.write("package/inside/file", "inside");
  fs::create_symlink("../secret", folder_ / "package/link");
  fs::create_directory_symlink("..", folder_ / "package/up");
  fs::create_symlink("file", folder_ / "package/inside/harmless");
  const Directory package(folder_ / "package");
  EXPECT_EQ(text_of(package.open("inside/file")), "inside");
  EXPECT_FALSE(package.find("none"));
  EXPECT_FALSE(package.find("none/file"));
  for (const char* name : {"../secret", "inside/../../secret", "/etc/passwd", "", ".", "inside//file", "./inside/file",
                           "link", "up/secret", "inside/harmless", "inside", "inside/file/"}) {
    EXPECT_THROW(static_cast<void>(package.find(name)), Error) << name;
  }
}

TEST_F(InputFiles, AWalkNamesEverythingButFolders) {
  fs::create_directories(folder_ / "package/a/b");
  folder_.write("package/one", "1");
  folder_.write("package/a/b/two", "2");
  fs::create_symlink("one", folder_ / "package/a/link");
  ASSERT_EQ(::mkfifo((folder_ / "package/pipe").c_str(), 0600), 0);
  std::vector<std::string> files, others;
  const Directory package(folder_ / "package");
  package.walk([&](const Directory::Entry& entry) {
    (entry.kind == Directory::Kind::file ? files : others).push_back(entry.name);
    return true;
  });
  std::sort(files.begin(), files.end());
  std::sort(others.begin(), others.end());
  EXPECT_EQ(files, (std::vector<std::string>{"a/b/two", "one"}));
  EXPECT_EQ(others, (std::vector<std::string>{"a/link", "pipe"}));
  int visited = 0;
  package.walk([&](const Directory::Entry&) { return ++visited < 2; });
  EXPECT_EQ(visited, 2);
}

TEST_F(InputFiles, AWalkHasALimitedDepth) {
  fs::path deep = folder_ / "package";
  for (int i = 0; i < 40; ++i) deep /= "d";
  fs::create_directories(deep);
  int visited = 0;
  Directory(folder_ / "package").walk([&](const Directory::Entry& entry) {
    EXPECT_EQ(entry.kind, Directory::Kind::other);
    return ++visited < 10;
  });
  EXPECT_EQ(visited, 1);
}

}  // namespace
}  // namespace nadir
