// Differences of files: what is made of them again, how small they are, and what hostile ones do.
#include "package_delta/file_delta.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/random.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

Bytes noise(std::size_t size, std::uint64_t seed) {
  Random random(seed);
  Bytes bytes(size);
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random.integer(0, 255));
  return bytes;
}

class FileDelta : public ::testing::Test {
 protected:
  InputFile file(const std::string& name, ByteView bytes) {
    write_file_atomic(folder_ / name, bytes);
    return InputFile(folder_ / name);
  }
  Bytes delta(const InputFile* old_file, const InputFile& new_file) {
    Bytes made;
    make_file_delta(old_file, new_file, [&](ByteView part) { made.insert(made.end(), part.begin(), part.end()); });
    return made;
  }
  // In parts of any size, as a medium gives them.
  Bytes apply(const InputFile* old_file, ByteView delta, std::size_t part_bytes = 777) {
    Bytes made;
    std::size_t at = 0;
    apply_file_delta(
        old_file,
        [&](std::span<std::uint8_t> target) {
          const std::size_t size = std::min({target.size(), delta.size() - at, part_bytes});
          std::copy_n(delta.begin() + static_cast<std::ptrdiff_t>(at), size, target.begin());
          at += size;
          return size;
        },
        [&](ByteView part) { made.insert(made.end(), part.begin(), part.end()); });
    return made;
  }

  test::TemporaryFolder folder_;
};

TEST_F(FileDelta, MakesTheNewFileOfTheOldOne) {
  const Bytes base = noise(300'000, 1);
  Bytes changed = base, shifted = noise(77, 2), shorter(base.begin(), base.begin() + 100'001);
  for (std::size_t i = 150'000; i < 153'000; ++i) changed[i] ^= 0x5A;
  shifted.insert(shifted.end(), base.begin(), base.end());
  const InputFile old_file = file("old", base);
  for (const Bytes& next : {base, changed, shifted, shorter, noise(50'000, 3), Bytes{}, Bytes{1}}) {
    const InputFile new_file = file("new", next);
    EXPECT_EQ(apply(&old_file, delta(&old_file, new_file)), next) << next.size();
    EXPECT_EQ(apply(nullptr, delta(nullptr, new_file)), next) << next.size();
    const InputFile empty = file("empty", {});
    EXPECT_EQ(apply(&empty, delta(&empty, new_file)), next) << next.size();
  }
}

TEST_F(FileDelta, IsAboutAsLargeAsWhatIsNew) {
  const Bytes base = noise(1'000'000, 1), piece = noise(4000, 2);
  Bytes next(base.begin(), base.begin() + 333'333);  // what follows moves by an odd number of bytes
  next.insert(next.end(), piece.begin(), piece.end());
  next.insert(next.end(), base.begin() + 333'333, base.end());
  const InputFile old_file = file("old", base), new_file = file("new", next);
  const std::size_t size = delta(&old_file, new_file).size();
  EXPECT_GE(size, piece.size());
  EXPECT_LE(size, piece.size() + 2 * 128 + 100);
  EXPECT_LT(delta(&old_file, old_file).size(), 100U);
  EXPECT_EQ(delta(&old_file, new_file), delta(&old_file, new_file)) << "the same bytes each time";
}

// The format is librsync's own: its program reads ours.
TEST_F(FileDelta, IsReadByRdiff) {
  if (test::run_shell("command -v rdiff && command -v zstd").code != 0) GTEST_SKIP() << "NOT TESTED: no rdiff or zstd";
  const InputFile old_file = file("old", noise(100'000, 1)), new_file = file("new", noise(40'000, 1));
  write_file_atomic(folder_ / "delta.zst", delta(&old_file, new_file));
  const auto read = test::run_shell("cd " + folder_.path().string() +
                                    " && zstd -qd delta.zst && rdiff patch old delta made && cmp made new");
  EXPECT_EQ(read.code, 0) << read.err;
}

TEST_F(FileDelta, RefusesWhatIsNoDelta) {
  const InputFile old_file = file("old", noise(20'000, 1)), new_file = file("new", noise(30'000, 4));
  const Bytes good = delta(&old_file, new_file);
  EXPECT_THROW(apply(&old_file, {}), Error);
  EXPECT_THROW(apply(&old_file, ByteView(good).first(good.size() - 1)), Error);
  EXPECT_THROW(apply(&old_file, ByteView(good).first(good.size() / 2)), Error);
  EXPECT_THROW(apply(&old_file, noise(1000, 9)), Error);
  EXPECT_THROW(apply(&old_file, delta(nullptr, new_file)), Error) << "compressed, but no delta";
  Bytes more = good;
  more.push_back(0);
  EXPECT_THROW(apply(&old_file, more), Error);
  const InputFile shorter = file("shorter", noise(100, 1));
  const InputFile same = file("same", noise(20'000, 1));
  EXPECT_THROW(apply(&shorter, delta(&old_file, same)), Error) << "bytes that the old file does not have";
  for (std::size_t at = 0; at < good.size(); at += 97) {  // any result, or an error
    Bytes bad = good;
    bad[at] ^= 0x10;
    try {
      apply(&old_file, bad);
    } catch (const Error&) {
    }
  }
}

TEST_F(FileDelta, FailuresOfTheSinkPassThrough) {
  const InputFile old_file = file("old", noise(20'000, 1));
  EXPECT_THROW(make_file_delta(&old_file, old_file, [](ByteView) { throw Interrupted(); }), Interrupted);
  const Bytes same = delta(&old_file, old_file);
  std::size_t at = 0;
  const ByteSource source = [&](std::span<std::uint8_t> target) {
    const std::size_t size = std::min(target.size(), same.size() - at);
    std::copy_n(same.begin() + static_cast<std::ptrdiff_t>(at), size, target.begin());
    at += size;
    return size;
  };
  EXPECT_THROW(apply_file_delta(&old_file, source, [](ByteView) { throw Interrupted(); }), Interrupted);
}

}  // namespace
}  // namespace nadir
