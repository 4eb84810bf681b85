#include "base/fs_verity.hpp"

#include <algorithm>
#include <array>
#include <memory>
#include <optional>

#include "base/ordered_work.hpp"

namespace nadir {
namespace {

constexpr std::size_t kPiece_bytes = 1 << 20;  // what a thread takes at once
constexpr std::size_t kRead_bytes = 1 << 16;   // stays in the processor's cache until it is hashed

std::size_t pieces_in(std::uint64_t bytes) { return (bytes + kPiece_bytes - 1) / kPiece_bytes; }

// Hashes pieces of a file. For one thread.
class PieceHasher {
 public:
  explicit PieceHasher(const InputFile& file) : file_(file), buffer_(kRead_bytes) {}

  // The digests of its blocks. whole: gets the bytes as well, or null. Nothing when the file has shrunk meanwhile.
  std::optional<std::vector<Sha256>> blocks_of(std::size_t piece, Sha256Stream* whole = nullptr) {
    std::vector<Sha256> digests;
    digests.reserve(kPiece_bytes / kVerityBlock_bytes);
    const std::uint64_t begin = std::uint64_t{piece} * kPiece_bytes, end = std::min(begin + kPiece_bytes, file_.size());
    for (std::uint64_t at = begin; at < end; at += kRead_bytes) {
      const std::span<std::uint8_t> bytes = std::span(buffer_).first(std::min<std::uint64_t>(kRead_bytes, end - at));
      if (!file_.read_at(at, bytes)) return std::nullopt;
      if (whole != nullptr) whole->update(bytes);
      for (std::size_t block = 0; block < bytes.size(); block += kVerityBlock_bytes) {
        digests.push_back(hash(bytes.subspan(block, std::min(kVerityBlock_bytes, bytes.size() - block))));
      }
    }
    return digests;
  }

 private:
  Sha256 hash(ByteView block) {
    stream_.update(block);
    if (block.size() < kVerityBlock_bytes) {
      static constexpr std::array<std::uint8_t, kVerityBlock_bytes> kZeros{};
      stream_.update(ByteView(kZeros).first(kVerityBlock_bytes - block.size()));
    }
    return stream_.finish();
  }

  const InputFile& file_;
  Bytes buffer_;
  Sha256Stream stream_;
};

}  // namespace

void VerityTree::add(const Sha256& block) { add(0, block); }

void VerityTree::add(std::size_t level, const Sha256& digest) {
  if (level == levels_.size()) levels_.emplace_back().digests.reserve(kVerityBlock_bytes);
  Bytes& digests = levels_[level].digests;
  if (digests.size() == kVerityBlock_bytes) {  // and not sooner: a lone digest is the root
    stream_.update(digests);
    digests.clear();
    add(level + 1, stream_.finish());
  }
  Level& own = levels_[level];
  own.digests.insert(own.digests.end(), digest.bytes.begin(), digest.bytes.end());
  ++own.count;
}

Sha256 VerityTree::root() {
  Sha256 root;
  for (std::size_t level = 0; level < levels_.size(); ++level) {
    Bytes& digests = levels_[level].digests;
    if (levels_[level].count == 1) {
      std::copy(digests.begin(), digests.end(), root.bytes.begin());
      break;
    }
    digests.resize(kVerityBlock_bytes);
    stream_.update(digests);
    add(level + 1, stream_.finish());
  }
  return root;
}

Sha256 VerityTree::finish(std::uint64_t file_bytes) {
  std::array<std::uint8_t, 256> descriptor{1, 1, 12};
  for (std::size_t i = 0; i < 8; ++i) descriptor[8 + i] = static_cast<std::uint8_t>(file_bytes >> (8 * i));
  const Sha256 top = root();
  std::copy(top.bytes.begin(), top.bytes.end(), descriptor.begin() + 16);
  return sha256(descriptor);
}

Sha256 verity_digest(const InputFile& file, int threads, const std::function<void()>& after_piece) {
  VerityTree tree;
  using Digests = std::optional<std::vector<Sha256>>;
  const auto make_worker = [&file]() -> std::function<Digests(std::size_t)> {
    return [hasher = std::make_shared<PieceHasher>(file)](std::size_t piece) { return hasher->blocks_of(piece); };
  };
  const auto take = [&](std::size_t, const Digests& blocks) {
    if (!blocks) return false;  // another digest
    for (const Sha256& block : *blocks) tree.add(block);
    if (after_piece) after_piece();
    return true;
  };
  work_in_order<Digests>(pieces_in(file.size()), threads, make_worker, take);
  return tree.finish(file.size());
}

FileDigests digests_of(const InputFile& file, const std::function<void()>& after_piece) {
  Sha256Stream whole;
  VerityTree tree;
  PieceHasher hasher(file);
  for (std::size_t piece = 0; piece < pieces_in(file.size()); ++piece) {
    const auto blocks = hasher.blocks_of(piece, &whole);
    if (!blocks) break;
    for (const Sha256& block : *blocks) tree.add(block);
    if (after_piece) after_piece();
  }
  return {whole.finish(), tree.finish(file.size())};
}

}  // namespace nadir
