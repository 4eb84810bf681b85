#include "candidates/audit_log.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "base/files.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

// A clock that a test sets.
class SetClock final : public Clock {
 public:
  UtcTime now() const override { return time; }
  UtcTime time{1'795'000'020};
};

class AuditLogTest : public ::testing::Test {
 protected:
  std::vector<nlohmann::json> lines(const char* file = "audit.jsonl") const {
    std::vector<nlohmann::json> all;
    std::istringstream text(read_text_file(folder_ / "audit" / file));
    for (std::string line; std::getline(text, line);) all.push_back(nlohmann::json::parse(line, nullptr, false));
    return all;
  }
  AuditLog log(AuditLimits limits = {}) { return AuditLog(folder_ / "audit", clock_, limits); }

  test::TemporaryFolder folder_;
  SetClock clock_;
};

TEST_F(AuditLogTest, RecordsWhoDidWhatWhenAndTheResult) {
  log().record({.act = "batch.announce",
                .result = "opened",
                .token = "ground-1",
                .client = "ground",
                .key = "ab",
                .subject = "mini-07",
                .detail = "tiles 3"});
  ASSERT_EQ(lines().size(), 1U);
  const nlohmann::json expected{{"n", 1},
                                {"at", "2026-11-18T11:47:00Z"},
                                {"act", "batch.announce"},
                                {"result", "opened"},
                                {"token", "ground-1"},
                                {"client", "ground"},
                                {"key", "ab"},
                                {"subject", "mini-07"},
                                {"detail", "tiles 3"}};
  nlohmann::json found = lines()[0];
  found["at"] = expected["at"];
  EXPECT_EQ(found, expected);
  struct stat facts {};
  ASSERT_EQ(::stat((folder_ / "audit" / "audit.jsonl").c_str(), &facts), 0);
  EXPECT_EQ(facts.st_mode & 0777, 0600U);
}

// Line feeds, separators of other alphabets, bytes that are no text: nothing begins a line of its own.
TEST_F(AuditLogTest, CallersCannotForgeLines) {
  const std::string evil = "x\n{\"n\":99,\"act\":\"forged\"}\r\n\xe2\x80\xa8\xc2\x85\x1b[31m\xff\xfe\0y";
  log().record(
      {.act = evil, .result = evil, .token = evil, .client = evil, .key = evil, .subject = evil, .detail = evil});
  const std::string text = read_text_file(folder_ / "audit" / "audit.jsonl");
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1);
  for (const char c : text) EXPECT_TRUE((c >= ' ' && c < 0x7f) || c == '\n') << static_cast<int>(c);
  EXPECT_EQ(lines()[0]["n"], 1);
  EXPECT_EQ(lines()[0]["detail"].get<std::string>().substr(0, 2), "x\n");
}

TEST_F(AuditLogTest, ContinuesItsCountAfterARestart) {
  for (int i = 1; i <= 3; ++i) {
    log().record({.act = "service.start", .result = "started"});
    EXPECT_EQ(lines().back()["n"], i);
  }
}

// Two processes with the log open: their lines do not interleave, and each has its own number.
TEST_F(AuditLogTest, TwoWritersShareOneCount) {
  AuditLog one = log(), two = log();
  for (int i = 0; i < 3; ++i) {
    one.record({.act = "one", .result = "done"});
    two.record({.act = "two", .result = "done"});
  }
  ASSERT_EQ(lines().size(), 6U);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(lines()[i]["n"], i + 1);
}

// A process was killed, or the disk filled up, during a write: the incomplete line stays, and no other line is lost.
TEST_F(AuditLogTest, TwoWritersShareOneCountOverFiles) {
  const AuditLimits limits{.file_bytes = 500, .files = 8, .equal_per_minute = 1000};
  AuditLog service = log(limits), worker = log(limits);
  for (int i = 0; i < 12; ++i) {
    service.record({.act = "batch.announce", .result = "opened"});
    worker.record({.act = "tiles.promote", .result = "promoted"});
    worker.record({.act = "tiles.promote", .result = "promoted"});
  }
  EXPECT_EQ(service.fault() + worker.fault(), "");
  std::vector<int> numbers;
  for (int age = 7; age >= 0; --age) {
    const std::string file = age == 0 ? "audit.jsonl" : "audit." + std::to_string(age) + ".jsonl";
    if (!fs::exists(folder_ / "audit" / file)) continue;
    for (const nlohmann::json& line : lines(file.c_str())) numbers.push_back(line["n"]);
  }
  ASSERT_EQ(numbers.size(), 36U);
  for (std::size_t i = 0; i < numbers.size(); ++i) EXPECT_EQ(numbers[i], static_cast<int>(i) + 1);
}

TEST_F(AuditLogTest, ATornLineIsTerminated) {
  log().record({.act = "one", .result = "done"});
  std::string text = read_text_file(folder_ / "audit" / "audit.jsonl");
  write_file_atomic(folder_ / "audit" / "audit.jsonl", text + R"({"n":2,"at":"20)");
  log().record({.act = "two", .result = "done"});
  ASSERT_EQ(lines().size(), 3U);
  EXPECT_TRUE(lines()[1].is_discarded());
  EXPECT_EQ(lines()[2]["n"], 2);
  EXPECT_EQ(lines()[2]["act"], "two");
}

TEST_F(AuditLogTest, RotatesAndDropsTheOldestFile) {
  {
    AuditLog small = log({.file_bytes = 1000, .files = 3, .equal_per_minute = 1'000'000});
    for (int i = 0; i < 500; ++i) small.record({.act = "act", .result = "done", .detail = std::to_string(i)});
    EXPECT_EQ(small.fault(), "");
  }
  int files = 0;
  for (const auto& entry : fs::directory_iterator(folder_ / "audit")) {
    ++files;
    EXPECT_LE(fs::file_size(entry.path()), 1000U);
  }
  EXPECT_EQ(files, 3);
  EXPECT_EQ(lines().back()["n"], 500);
  std::int64_t next = lines("audit.2.jsonl").front()["n"];
  for (const char* file : {"audit.2.jsonl", "audit.1.jsonl", "audit.jsonl"}) {
    for (const auto& line : lines(file)) EXPECT_EQ(line["n"], next++) << file;
  }
  log({.file_bytes = 1000, .files = 3}).record({.act = "next", .result = "done"});
  EXPECT_EQ(lines().back()["n"], 501);
}

// Equal acts of one caller beyond a rate are counted; those of others are written all the same.
TEST_F(AuditLogTest, AFloodIsCountedAndDisplacesNothing) {
  AuditLog bounded = log({.equal_per_minute = 3});
  for (int i = 0; i < 100; ++i) bounded.record({.act = "call", .result = "refused", .token = "loud"});
  bounded.record({.act = "call", .result = "refused", .token = "quiet"});
  EXPECT_EQ(lines().size(), 4U);
  bounded.flush();
  EXPECT_EQ(lines().size(), 4U) << "the minute is not over";
  clock_.time.unix_s += 60;
  bounded.flush();
  ASSERT_EQ(lines().size(), 5U);
  EXPECT_EQ(lines()[4]["token"], "loud");
  EXPECT_EQ(lines()[4]["more"], 97);
  bounded.record({.act = "call", .result = "refused", .token = "loud"});
  EXPECT_EQ(lines().size(), 6U);
}

// Whatever is wrong with the disk: the caller goes on, and the log itself says later how many lines are missing.
TEST_F(AuditLogTest, UnwrittenLinesAreCountedAndReported) {
  folder_.write("audit", "a file in the folder's place");
  AuditLog broken = log();
  EXPECT_NE(broken.fault(), "");
  broken.record({.act = "one", .result = "done"});
  broken.record({.act = "two", .result = "done"});
  EXPECT_NE(broken.fault().find("missing from the audit log"), std::string::npos) << broken.fault();
  fs::remove(folder_ / "audit");
  broken.record({.act = "three", .result = "done"});
  EXPECT_EQ(broken.fault(), "");
  ASSERT_EQ(lines().size(), 2U);
  EXPECT_EQ(lines()[0]["act"], "audit.gap");
  EXPECT_EQ(lines()[0]["subject"], "lines 2");
  EXPECT_EQ(lines()[1]["act"], "three");
}

// A caller that stays away does not keep the gap from being recorded, and looking for room is no line that is missing.
TEST_F(AuditLogTest, AGapIsRecordedAsSoonAsThereIsRoom) {
  folder_.write("audit", "a file in the folder's place");
  AuditLog broken = log();
  broken.record({.act = "one", .result = "done"});
  for (int i = 0; i < 3; ++i) broken.flush();
  EXPECT_NE(broken.fault(), "");
  fs::remove(folder_ / "audit");
  broken.flush();
  broken.flush();
  EXPECT_EQ(broken.fault(), "");
  ASSERT_EQ(lines().size(), 1U);
  EXPECT_EQ(lines()[0]["subject"], "lines 1");
}

// A worker that was stopped in the middle of a line: its lock is of another open file, as another process's is.
TEST_F(AuditLogTest, AProcessThatHangsWithTheLockHoldsNobodyUp) {
  AuditLog waiting = log();
  waiting.record({.act = "one", .result = "done"});
  const int other = ::open((folder_ / "audit" / "audit.jsonl").c_str(), O_RDWR | O_CLOEXEC);
  ASSERT_EQ(::flock(other, LOCK_EX | LOCK_NB), 0);
  for (const char* act : {"two", "three"}) waiting.record({.act = act, .result = "done"});
  EXPECT_NE(waiting.fault().find("locked for too long"), std::string::npos) << waiting.fault();
  ::close(other);
  waiting.record({.act = "four", .result = "done"});
  EXPECT_EQ(waiting.fault(), "");
  ASSERT_EQ(lines().size(), 3U);
  EXPECT_EQ(lines()[1]["subject"], "lines 2");
  EXPECT_EQ(lines()[2]["act"], "four");
}

TEST_F(AuditLogTest, DoesNotFollowASymbolicLink) {
  const auto target = folder_.write("target", "untouched");
  fs::create_directories(folder_ / "audit");
  fs::create_symlink(target, folder_ / "audit" / "audit.jsonl");
  AuditLog linked = log();
  linked.record({.act = "one", .result = "done"});
  EXPECT_NE(linked.fault(), "");
  EXPECT_EQ(read_text_file(target), "untouched");
}

}  // namespace
}  // namespace nadir
