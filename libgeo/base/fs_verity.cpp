#include "base/fs_verity.hpp"

#include <algorithm>
#include <array>
#include <memory>
#include <optional>

#include "base/ordered_work.hpp"

namespace nadir {
namespace {

constexpr std::size_t kPiece_bytes = 1 << 20;
constexpr std::size_t kDigest_bytes = sizeof(Sha256::bytes);

// Digests of the blocks of a piece of a file.
class BlockHasher {
 public:
  std::vector<Sha256> operator()(ByteView piece) {
    std::vector<Sha256> digests;
    digests.reserve(piece.size() / kVerityBlock_bytes + 1);
    for (; piece.size() >= kVerityBlock_bytes; piece = piece.subspan(kVerityBlock_bytes)) {
      digests.push_back(hash(piece.first(kVerityBlock_bytes)));
    }
    if (!piece.empty()) {
      std::array<std::uint8_t, kVerityBlock_bytes> filled_up{};
      std::copy(piece.begin(), piece.end(), filled_up.begin());
      digests.push_back(hash(filled_up));
    }
    return digests;
  }

 private:
  Sha256 hash(ByteView block) {
    stream_.update(block);
    return stream_.finish();
  }
  Sha256Stream stream_;
};

std::size_t pieces_in(std::uint64_t bytes) { return (bytes + kPiece_bytes - 1) / kPiece_bytes; }

// A piece of the file in a buffer that is used again for the next one.
class PieceReader {
 public:
  explicit PieceReader(const InputFile& file)
      : file_(file), buffer_(std::min<std::uint64_t>(kPiece_bytes, std::max<std::uint64_t>(file.size(), 1))) {}

  // Nothing when the file has shrunk meanwhile.
  std::optional<ByteView> read(std::size_t piece) {
    const std::uint64_t at = std::uint64_t{piece} * kPiece_bytes;
    const std::span target = std::span(buffer_).first(std::min<std::uint64_t>(kPiece_bytes, file_.size() - at));
    if (!file_.read_at(at, target)) return std::nullopt;
    return target;
  }

 private:
  const InputFile& file_;
  Bytes buffer_;
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
    return [reader = std::make_shared<PieceReader>(file), hash = std::make_shared<BlockHasher>()](std::size_t item) {
      const auto piece = reader->read(item);
      return piece ? Digests((*hash)(*piece)) : Digests();
    };
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
  PieceReader reader(file);
  BlockHasher hash;
  for (std::size_t i = 0; i < pieces_in(file.size()); ++i) {
    const auto piece = reader.read(i);
    if (!piece) break;
    whole.update(*piece);
    for (const Sha256& block : hash(*piece)) tree.add(block);
    if (after_piece) after_piece();
  }
  return {whole.finish(), tree.finish(file.size())};
}

}  // namespace nadir
