#include "package_build/build_journal.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

constexpr std::string_view kConfiguration = "mission: a\nquality: 75\n";

Bytes bytes_of(std::string_view text) {
  const ByteView view = as_bytes(text);
  return {view.begin(), view.end()};
}

class Journal : public testing::Test {
 protected:
  Journal() {
    BuildJournal journal(path_, kConfiguration);
    EXPECT_FALSE(journal.next());
    journal.add(bytes_of("first"));
    journal.add(bytes_of(""));
    journal.add(bytes_of("third"));
  }

  std::vector<std::string> records() {
    std::vector<std::string> result;
    BuildJournal journal(path_, kConfiguration);
    while (const auto record = journal.next()) result.emplace_back(as_text(*record));
    return result;
  }

  void write(const Bytes& bytes) {
    std::ofstream(path_, std::ios::binary | std::ios::trunc)
        .write(as_text(bytes).data(), static_cast<std::streamsize>(bytes.size()));
  }

  test::TemporaryFolder folder_;
  std::filesystem::path path_ = folder_ / "journal";
};

TEST_F(Journal, ReturnsItsRecordsAndContinues) {
  EXPECT_EQ(records(), (std::vector<std::string>{"first", "", "third"}));
  {
    BuildJournal journal(path_, kConfiguration);
    while (journal.next()) {
    }
    journal.add(bytes_of("fourth"));
  }
  EXPECT_EQ(records(), (std::vector<std::string>{"first", "", "third", "fourth"}));
}

// Cut anywhere, it holds a beginning of its records, and what is added then follows them.
TEST_F(Journal, TruncatedAnywhereItHoldsCompleteRecords) {
  const Bytes whole = read_file(path_);
  const std::vector<std::string> all = records();
  std::size_t most = 0;
  for (std::size_t size = 0; size < whole.size(); ++size) {
    write({whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size)});
    std::vector<std::string> kept = records();
    ASSERT_LT(kept.size(), all.size()) << size;
    EXPECT_TRUE(std::equal(kept.begin(), kept.end(), all.begin())) << size;
    EXPECT_GE(kept.size(), most);
    most = kept.size();
    {
      BuildJournal journal(path_, kConfiguration);
      while (journal.next()) {
      }
      journal.add(bytes_of("more"));
    }
    kept.emplace_back("more");
    EXPECT_EQ(records(), kept) << size;
  }
  EXPECT_EQ(most, 2);
}

// A power cut can leave blocks that were never written.
TEST_F(Journal, AFlippedByteEndsTheJournal) {
  const Bytes whole = read_file(path_);
  const std::vector<std::string> all = records();
  for (std::size_t at = 0; at < whole.size(); ++at) {
    Bytes damaged = whole;
    damaged[at] ^= 0x10;
    write(damaged);
    const std::vector<std::string> kept = records();
    ASSERT_LT(kept.size(), all.size()) << at;
    EXPECT_TRUE(std::equal(kept.begin(), kept.end(), all.begin())) << at;
  }
}

TEST_F(Journal, AnotherConfigurationIsRejectedAndTheFileKept) {
  const Bytes whole = read_file(path_);
  try {
    BuildJournal journal(path_, "mission: a\nquality: 80\n");
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_EQ(error.text().expected, "quality: 75");
    EXPECT_EQ(error.text().found, "quality: 80");
  }
  EXPECT_EQ(read_file(path_), whole);
}

}  // namespace
}  // namespace nadir
