#include "base/fs_verity.hpp"

#ifdef NADIR_WITH_IPSEC_MB
#include <intel-ipsec-mb.h>
#endif

#include <algorithm>
#include <array>
#include <memory>
#include <optional>

#include "base/error.hpp"
#include "base/ordered_work.hpp"

namespace nadir {
namespace {

constexpr std::size_t kPiece_bytes = 1 << 20;  // what a thread takes at once
constexpr std::size_t kRead_bytes = 1 << 16;   // stays in the processor's cache until it is hashed

std::size_t pieces_in(std::uint64_t bytes) { return (bytes + kPiece_bytes - 1) / kPiece_bytes; }

#ifdef NADIR_WITH_IPSEC_MB

// Blocks do not depend on each other, so as many are hashed at once as a vector of the processor has lanes: SHA-256 in
// 16 lanes of AVX-512 is 6 times as fast as OpenSSL's in one, where the processor has no instructions for SHA.
class BlockHasher {
 public:
  BlockHasher() : manager_(alloc_mb_mgr(0), &free_mb_mgr) {
    IMB_ARCH found = IMB_ARCH_NONE;
    if (manager_) init_mb_mgr_auto(manager_.get(), &found);
    if (found == IMB_ARCH_NONE) manager_.reset();  // a processor without SSE 4.2
  }

  // Appends the digest of each. blocks: whole ones, one after the other.
  void hash(ByteView blocks, std::vector<Sha256>& digests) {
    const std::size_t before = digests.size(), count = blocks.size() / kVerityBlock_bytes;
    digests.resize(before + count);
    if (!manager_) {
      for (std::size_t i = 0; i < count; ++i) digests[before + i] = sha256(block(blocks, i));
      return;
    }
    std::size_t done = 0;
    const auto take = [&done](const IMB_JOB* job) { done += job->status == IMB_STATUS_COMPLETED ? 1 : 0; };
    for (std::size_t i = 0; i < count; ++i) {
      IMB_JOB* job = IMB_GET_NEXT_JOB(manager_.get());
      *job = {};
      job->cipher_mode = IMB_CIPHER_NULL;
      job->cipher_direction = IMB_DIR_ENCRYPT;
      job->chain_order = IMB_ORDER_HASH_CIPHER;
      job->hash_alg = IMB_AUTH_SHA_256;
      job->src = block(blocks, i).data();
      job->msg_len_to_hash_in_bytes = kVerityBlock_bytes;
      job->auth_tag_output = digests[before + i].bytes.data();
      job->auth_tag_output_len_in_bytes = digests[before + i].bytes.size();
      for (job = IMB_SUBMIT_JOB(manager_.get()); job != nullptr; job = IMB_GET_COMPLETED_JOB(manager_.get())) take(job);
    }
    while (const IMB_JOB* job = IMB_FLUSH_JOB(manager_.get())) take(job);
    if (done == count) return;
    throw Error({.what = "the library for multi-buffer cryptography computes no SHA-256",
                 .found = imb_get_strerror(imb_get_errno(manager_.get())),
                 .fix = "check the installation of libipsec-mb1"});
  }

 private:
  static ByteView block(ByteView blocks, std::size_t i) {
    return blocks.subspan(i * kVerityBlock_bytes, kVerityBlock_bytes);
  }

  std::unique_ptr<IMB_MGR, decltype(&free_mb_mgr)> manager_;
};

#else

class BlockHasher {
 public:
  void hash(ByteView blocks, std::vector<Sha256>& digests) {
    for (std::size_t at = 0; at < blocks.size(); at += kVerityBlock_bytes) {
      digests.push_back(sha256(blocks.subspan(at, kVerityBlock_bytes)));
    }
  }
};

#endif

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
      const std::size_t whole_blocks =
          (bytes.size() + kVerityBlock_bytes - 1) / kVerityBlock_bytes * kVerityBlock_bytes;
      std::fill(buffer_.begin() + static_cast<std::ptrdiff_t>(bytes.size()),
                buffer_.begin() + static_cast<std::ptrdiff_t>(whole_blocks), std::uint8_t{0});
      hasher_.hash(ByteView(buffer_).first(whole_blocks), digests);
    }
    return digests;
  }

 private:
  const InputFile& file_;
  Bytes buffer_;
  BlockHasher hasher_;
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
