#include "package_build/work_shards.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <numeric>

#include "base/files.hpp"
#include "package_build/numbered_work.hpp"
#include "support/process.hpp"
#include "support/small_disk.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using test::NumberedWork;
using testing::HasSubstr;

constexpr std::size_t kTasks = 20;

class WorkShards : public ::testing::Test {
 protected:
  WorkShards() { fs::create_directory(folder_ / "shards"); }

  WorkShardRequest request(int shard, int shards) {
    WorkShardRequest request;
    request.work = "numbers";
    request.inputs = "package: a\n";
    request.number = {shard, shards};
    request.folder = folder_ / "shards";
    request.threads = 2;
    request.on_remark = [this](std::string_view remark) { remarks_.emplace_back(remark); };
    return request;
  }
  WorkShardReport make(int shard, int shards) { return do_shard(work_, request(shard, shards), progress_); }
  void take(SharedWork& work, const std::vector<fs::path>& folders, const std::string& inputs = "package: a\n") {
    take_shards(work, "numbers", inputs, folders, "nadir number PACKAGE", progress_);
  }
  fs::path shard(int number, int shards) const {
    return folder_ / "shards" / shard_folder_name("numbers", number, shards);
  }
  ErrorText error_of(const std::function<void()>& action) {
    try {
      action();
    } catch (const Error& error) {
      return error.text();
    }
    ADD_FAILURE() << "no error";
    return {};
  }
  ErrorText taking_fails() {
    NumberedWork work(kTasks);
    return error_of([&] { take(work, {folder_ / "shards"}); });
  }

  test::TemporaryFolder folder_;
  NumberedWork work_{kTasks};
  NoProgress progress_;
  std::vector<std::string> remarks_;
};

TEST_F(WorkShards, GiveTheResultsOfOneMachineWhateverTheirNumber) {
  std::vector<std::size_t> all(kTasks);
  std::iota(all.begin(), all.end(), 0);
  NumberedWork alone(kTasks);
  do_alone(alone, 3, progress_);
  EXPECT_EQ(alone.added, all);
  for (const int shards : {1, 2, 3, 8, 20, 25}) {  // of more than there are tasks some are empty
    fs::remove_all(folder_ / "shards");
    fs::create_directory(folder_ / "shards");
    std::size_t tasks = 0;
    for (int i = shards; i >= 1; --i) {  // in any order
      const WorkShardReport report = make(i, shards);
      EXPECT_LE(report.tasks, kTasks / static_cast<std::size_t>(shards) + 1);
      tasks += report.tasks;
    }
    EXPECT_EQ(tasks, kTasks);
    NumberedWork taken(kTasks);
    take(taken, {folder_ / "shards"});
    EXPECT_EQ(taken.added, all) << shards;
  }
}

TEST_F(WorkShards, OneThatIsThereIsCheckedAndLeftAsItIs) {
  make(1, 2);
  const WorkShardReport made = make(2, 2);
  EXPECT_FALSE(made.was_there);
  const fs::path file = made.folder / kJournalFile;
  const Bytes good = read_file(file);
  const auto time = fs::last_write_time(file);
  EXPECT_TRUE(make(2, 2).was_there);
  EXPECT_EQ(fs::last_write_time(file), time);
  const std::vector<std::function<void(Bytes&)>> damages = {
      [](Bytes& bytes) { bytes[bytes.size() / 2] ^= 1; }, [](Bytes& bytes) { bytes.resize(bytes.size() - 1); },
      [](Bytes& bytes) { bytes.push_back(0); }, [](Bytes& bytes) { bytes.clear(); }};
  for (const auto& damage : damages) {
    Bytes bytes = good;
    damage(bytes);
    write_file_atomic(file, bytes);
    EXPECT_THAT(error_of([&] { make(2, 2); }).where, HasSubstr("numbers-2-of-2"));
    EXPECT_THAT(taking_fails().where, HasSubstr("numbers-2-of-2"));
  }
  // Whole records, but not those of its tasks: one too few, one twice, one of another task.
  const auto rewrite = [&](const std::vector<std::size_t>& which) {
    write_file_atomic(file, good);
    JournalReader records(file);
    std::vector<Bytes> results;
    while (auto record = records.next()) results.push_back(*record);
    BuildJournal changed(folder_ / "changed", records.configuration());
    EXPECT_FALSE(changed.next());
    for (const std::size_t i : which) changed.add(results[i]);
    fs::rename(folder_ / "changed", file);
  };
  rewrite({0, 1, 2, 3, 4, 5, 6, 7, 8});
  EXPECT_EQ(taking_fails().found, "9");
  rewrite({0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9});
  EXPECT_EQ(taking_fails().found, "what is no result of task 20");
  rewrite({1, 0, 2, 3, 4, 5, 6, 7, 8, 9});
  EXPECT_EQ(taking_fails().found, "what is no result of task 10");
}

TEST_F(WorkShards, AWrongSetIsRefused) {
  EXPECT_EQ(taking_fails().what, "there are no shards");
  make(2, 3);
  EXPECT_THAT(taking_fails().found, HasSubstr("no 1, 3"));
  EXPECT_THAT(taking_fails().fix, HasSubstr("nadir number PACKAGE --shard 1/3"));
  make(1, 3), make(3, 3);
  make(1, 2);
  EXPECT_THAT(taking_fails().found, HasSubstr("of 2, of 3"));
  fs::remove_all(shard(1, 2));

  NumberedWork other(kTasks, "two");
  const ErrorText options = error_of([&] { take(other, {folder_ / "shards"}); });
  EXPECT_EQ(options.expected, "secret: two");
  EXPECT_EQ(options.found, "secret: one");
  NumberedWork work(kTasks);
  EXPECT_EQ(error_of([&] { take(work, {folder_ / "shards"}, "package: b\n"); }).found, "package: a");
  NumberedWork more(kTasks + 1);
  EXPECT_THAT(error_of([&] { take(more, {folder_ / "shards"}); }).found, HasSubstr("of 20"));
  EXPECT_TRUE(other.added.empty() && work.added.empty() && more.added.empty()) << "before the work";

  // Spread over two folders; one twice.
  fs::create_directory(folder_ / "more");
  fs::rename(shard(3, 3), folder_ / "more" / "numbers-3-of-3");
  take(work, {folder_ / "shards", folder_ / "more"});
  EXPECT_EQ(work.added.size(), kTasks);
  fs::copy(folder_ / "more" / "numbers-3-of-3", shard(3, 3), fs::copy_options::recursive);
  EXPECT_EQ(error_of([&] { take(work, {folder_ / "shards", folder_ / "more"}); }).what, "a shard is there twice");
  EXPECT_THAT(error_of([&] { take(work, {folder_ / "nowhere"}); }).fix, HasSubstr("--shards"));
}

TEST_F(WorkShards, NamesThatAreNoShardsAreNotCounted) {
  make(1, 1);
  for (const char* name : {"numbers-1-of-0", "numbers--1-of-2", "numbers-x-of-3", "numbers-of-4", "numbersof-1-of-5",
                           "numbers-1-of-99999999999999999999", "other-1-of-6", "numbers-01-of-7"}) {
    fs::create_directory(folder_ / "shards" / name);
  }
  NumberedWork work(kTasks);
  take(work, {folder_ / "shards"});
  EXPECT_EQ(work.added.size(), kTasks);
}

TEST_F(WorkShards, ADamagedInputEndsItBeforeItsResultIsKept) {
  WorkShardRequest damaged = request(1, 1);
  int kept = 0;
  damaged.check_inputs = [&] {
    if (++kept > 5) throw Error({.what = "a tile of the package is damaged"});
  };
  EXPECT_EQ(error_of([&] { do_shard(work_, damaged, progress_); }).what, "a tile of the package is damaged");
  EXPECT_FALSE(fs::exists(shard(1, 1)));
  EXPECT_EQ(make(1, 1).resumed, 5U);
  // What was interrupted with other options is not continued, and stays.
  fs::rename(shard(1, 1), folder_ / "shards" / ".numbers-1-of-1.staging");
  const NumberedWork other(kTasks, "two");
  EXPECT_THAT(error_of([&] { do_shard(other, request(1, 1), progress_); }).fix, HasSubstr("remove"));
  EXPECT_EQ(make(1, 1).resumed, kTasks);
}

TEST_F(WorkShards, KilledAnywhereItContinues) {
  make(2, 2);
  const Bytes whole = read_file(shard(2, 2) / kJournalFile);
  const auto killed = [&](int event) {
    fs::remove_all(shard(2, 2));
    return test::run_process({NADIR_KILLED_SHARD, folder_ / "shards", "work", "2/2", std::to_string(event)});
  };
  const auto counted = killed(0);
  ASSERT_EQ(counted.code, 0) << counted.err;
  EXPECT_EQ(read_file(shard(2, 2) / kJournalFile), whole);
  const int events = std::stoi(counted.out);
  for (int event = 1; event < events; ++event) {
    ASSERT_EQ(killed(event).code, 128 + SIGKILL) << event;
    EXPECT_FALSE(fs::exists(shard(2, 2))) << event;
    remarks_.clear();
    EXPECT_TRUE(make(2, 2).resumed > 0 || event < 4) << event;
    EXPECT_EQ(remarks_, std::vector<std::string>{"continuing a shard that was interrupted"});
    EXPECT_EQ(read_file(shard(2, 2) / kJournalFile), whole) << event;
  }
}

TEST_F(WorkShards, AFullDiskLosesNothing) {
  test::SmallDisk disk(folder_ / "small", "size=8k");
  if (!disk.mounted()) GTEST_SKIP() << "NOT TESTED: a full disk needs root and a tmpfs to mount";
  const NumberedWork large(400);
  WorkShardRequest full = request(1, 1);
  full.folder = folder_ / "small";
  EXPECT_THAT(error_of([&] { do_shard(large, full, progress_); }).fix, HasSubstr("run the same command again"));
  EXPECT_FALSE(fs::exists(folder_ / "small" / "numbers-1-of-1"));
  ASSERT_TRUE(disk.resize("1m"));
  EXPECT_GT(do_shard(large, full, progress_).resumed, 0U);
}

TEST_F(WorkShards, TheirNumbersComeFromTheCommandLineOrTheScheduler) {
  std::map<std::string, std::string> environment;
  const auto number = [&](std::string_view text) {
    const auto [shard, shards] = parse_shard_number(text, [&](const char* name) -> std::optional<std::string> {
      const auto found = environment.find(name);
      return found == environment.end() ? std::nullopt : std::optional(found->second);
    });
    return std::pair(shard, shards);
  };
  EXPECT_EQ(number("3/8"), std::pair(3, 8));
  environment["JOB_COMPLETION_INDEX"] = "0";
  EXPECT_EQ(number("auto/8"), std::pair(1, 8));
  for (const char* text : {"3", "auto", "0/8", "9/8", "3/0", "3/-1", "3/100001", "/8", "3/", "x/8", "3/8/9"}) {
    EXPECT_THROW(number(text), UsageError) << text;
  }
}

}  // namespace
}  // namespace nadir
