// A file's digest as Linux' fs-verity defines it (Documentation/filesystems/fsverity.rst): a SHA-256 tree over its
// blocks of 4096 bytes, without salt. `fsverity digest FILE` prints the same.
//
//   level 0    SHA-256 of each block of the file, the last one filled up with zeros
//   level i+1  SHA-256 of each block of 128 digests of level i, likewise filled up; until one digest is left, the root
//   digest     SHA-256(version:u8 = 1, SHA-256:u8 = 1, log2 of the block:u8 = 12, no salt:u8 = 0, 0:u32le,
//                      size:u64le, root and zeros up to 64 bytes, 176 zeros)
//
// Like a digest of all bytes it changes with each of them, and with the size, which fixes the number of levels: what is
// a block of the file in one tree cannot be a block of digests in another. Unlike one, it can be computed by several
// threads.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "base/bytes.hpp"
#include "base/digest.hpp"
#include "base/input_file.hpp"

namespace nadir {

inline constexpr std::size_t kVerityBlock_bytes = 4096;

// Digests of the file's blocks, one after the other, to the file's. Memory: one block for each level.
class VerityTree {
 public:
  void add(const Sha256& block);
  Sha256 finish(std::uint64_t file_bytes);  // once, after all blocks

 private:
  void add(std::size_t level, const Sha256& digest);
  Sha256 root();

  struct Level {
    Bytes digests;  // that no block of the next level holds yet
    std::uint64_t count = 0;
  };
  std::vector<Level> levels_;
  Sha256Stream stream_;
};

// Of the file's first size() bytes. after_piece: called by the calling thread for every started MiB.
Sha256 verity_digest(const InputFile& file, int threads, const std::function<void()>& after_piece = {});

// Both digests of a file in one pass over its bytes.
struct FileDigests {
  Sha256 sha256;
  Sha256 verity;
};
FileDigests digests_of(const InputFile& file, const std::function<void()>& after_piece = {});

}  // namespace nadir
