#include "trust/merkle.hpp"

#include <array>

namespace nadir {
namespace {

void put_u32(std::uint8_t* at, std::uint32_t value) {
  for (int i = 0; i < 4; ++i) at[i] = static_cast<std::uint8_t>(value >> (24 - 8 * i));
}

}  // namespace

Sha256 MerkleTree::leaf(const TileKey& key, const Sha256& tile_digest) {
  std::array<std::uint8_t, 1 + 1 + 4 + 4 + 32> bytes{};
  bytes[0] = 0x00;
  bytes[1] = key.z;
  put_u32(&bytes[2], key.x);
  put_u32(&bytes[6], key.y);
  std::copy(tile_digest.bytes.begin(), tile_digest.bytes.end(), bytes.begin() + 10);
  return sha256(bytes);
}

Sha256 MerkleTree::node(const Sha256& left, const Sha256& right) {
  std::array<std::uint8_t, 1 + 32 + 32> bytes{};
  bytes[0] = 0x01;
  std::copy(left.bytes.begin(), left.bytes.end(), bytes.begin() + 1);
  std::copy(right.bytes.begin(), right.bytes.end(), bytes.begin() + 33);
  return sha256(bytes);
}

void MerkleTree::add(const TileKey& key, const Sha256& tile_digest) { add_leaf(leaf(key, tile_digest)); }

void MerkleTree::add_leaf(const Sha256& leaf) {
  // Like adding one to a binary counter: each carry joins the two smallest full subtrees of the same size.
  Sha256 subtree = leaf;
  for (std::uint64_t carries = count_; (carries & 1) != 0; carries >>= 1) {
    subtree = node(peaks_.back(), subtree);
    peaks_.pop_back();
  }
  peaks_.push_back(subtree);
  ++count_;
}

Sha256 MerkleTree::root() const {
  if (peaks_.empty()) return sha256({});
  Sha256 right = peaks_.back();
  for (std::size_t i = peaks_.size() - 1; i-- > 0;) right = node(peaks_[i], right);
  return right;
}

}  // namespace nadir
