#include "trust/merkle.hpp"

#include <gtest/gtest.h>

#include "base/random.hpp"

namespace nadir {
namespace {

// RFC 6962, 2.1, implemented literally: split at the largest power of two below n.
Sha256 brute_force(const std::vector<Sha256>& leaves, std::size_t begin, std::size_t end) {
  const std::size_t n = end - begin;
  if (n == 0) return sha256({});
  if (n == 1) return leaves[begin];
  std::size_t k = 1;
  while (k * 2 < n) k *= 2;
  const Sha256 left = brute_force(leaves, begin, begin + k), right = brute_force(leaves, begin + k, end);
  Bytes bytes{0x01};
  bytes.insert(bytes.end(), left.bytes.begin(), left.bytes.end());
  bytes.insert(bytes.end(), right.bytes.begin(), right.bytes.end());
  return sha256(bytes);
}

TEST(Merkle, EqualsTheDefinitionForEveryCount) {
  Random random(7);
  std::vector<Sha256> leaves;
  MerkleTree tree;
  EXPECT_EQ(tree.root(), brute_force(leaves, 0, 0));
  for (std::uint32_t i = 0; i < 300; ++i) {
    Sha256 digest;
    for (auto& byte : digest.bytes) byte = static_cast<std::uint8_t>(random.integer(0, 255));
    const TileKey key{19, i, 2 * i};
    tree.add(key, digest);
    leaves.push_back(MerkleTree::leaf(key, digest));
    ASSERT_EQ(tree.root(), brute_force(leaves, 0, leaves.size())) << leaves.size() << " leaves";
  }
  EXPECT_EQ(tree.count(), 300U);
}

TEST(Merkle, EmptyTreeIsTheDigestOfNoBytes) {
  EXPECT_EQ(MerkleTree().root().hex(), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
}

// 0x00, z, x and y big-endian, digest: the byte layout is part of the file format.
TEST(Merkle, LeafHasItsDocumentedBytes) {
  Sha256 digest;
  digest.bytes.fill(0xAB);
  Bytes bytes{0x00, 19, 0x00, 0x06, 0xAF, 0x16, 0x00, 0x03, 0x71, 0xE3};
  bytes.insert(bytes.end(), 32, 0xAB);
  EXPECT_EQ(MerkleTree::leaf({19, 438038, 225763}, digest), sha256(bytes));
}

TEST(Merkle, DetectsSwappedTiles) {
  const Sha256 a = sha256(as_bytes("a")), b = sha256(as_bytes("b"));
  MerkleTree original, swapped;
  original.add({1, 0, 0}, a), original.add({1, 0, 1}, b);
  swapped.add({1, 0, 0}, b), swapped.add({1, 0, 1}, a);
  EXPECT_NE(original.root(), swapped.root());
}

}  // namespace
}  // namespace nadir
