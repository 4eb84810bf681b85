// The Merkle tree over a tile set, in the shape of RFC 6962 (section 2.1):
//   leaf = SHA-256(0x00 ‖ z:u8 ‖ x:u32be ‖ y:u32be ‖ sha256 of the tile's bytes)
//   node = SHA-256(0x01 ‖ left ‖ right), the left subtree being the largest full one; no leaves: SHA-256("")
//
// The leaf holds the tile's address, so that two tiles cannot be swapped. Leaves stream in: memory is one digest per
// level.
#pragma once

#include <cstdint>
#include <vector>

#include "base/digest.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {

class MerkleTree {
 public:
  // Leaves must be added in the order of TileKey.
  void add(const TileKey& key, const Sha256& tile_digest);
  void add_leaf(const Sha256& leaf);

  std::uint64_t count() const { return count_; }
  Sha256 root() const;

  static Sha256 leaf(const TileKey& key, const Sha256& tile_digest);
  static Sha256 node(const Sha256& left, const Sha256& right);

 private:
  std::vector<Sha256> peaks_;  // roots of full subtrees, largest first: one per set bit of count_
  std::uint64_t count_ = 0;
};

}  // namespace nadir
