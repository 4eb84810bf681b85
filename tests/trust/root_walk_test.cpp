#include "trust/root.hpp"

#include <gtest/gtest.h>

namespace nadir {
namespace {

class RootWalking : public ::testing::Test {
 protected:
  TrustRoot version(std::int64_t number, const PrivateKey& root_key) const {
    TrustRoot root;
    root.version = number;
    root.expires = {2'000'000'000};
    for (Role* role : {&root.root, &root.package_signer}) {
      root.add_key(root_key.public_key());
      role->key_ids.insert(root_key.public_key().id());
    }
    return root;
  }
  void put(std::int64_t number, const PrivateKey& root_key, const std::vector<const PrivateKey*>& signers) {
    documents_[number] = sign_root(version(number, root_key), signers).json();
  }
  RootSuccession walk(std::int64_t from = 1) {
    return follow_root_chain(version(from, a_), [this](std::int64_t wanted) -> std::optional<RootDocument> {
      const auto found = documents_.find(wanted);
      if (found == documents_.end()) return std::nullopt;
      return RootDocument{found->second, "test"};
    });
  }

  PrivateKey a_ = PrivateKey::generate(), b_ = PrivateKey::generate(), c_ = PrivateKey::generate();
  std::map<std::int64_t, std::string> documents_;
};

TEST_F(RootWalking, WithoutNewerRootsStaysWhereItIs) {
  const RootSuccession result = walk();
  EXPECT_EQ(result.root.version, 1);
  EXPECT_TRUE(result.newer.empty());
  EXPECT_TRUE(result.findings.empty());
}

TEST_F(RootWalking, GoesEveryStepWithNewKeys) {
  put(2, b_, {&a_, &b_});
  put(3, c_, {&b_, &c_});
  const RootSuccession result = walk();
  EXPECT_EQ(result.root.version, 3);
  EXPECT_EQ(result.newer.size(), 2U);
  EXPECT_TRUE(result.root.root.key_ids.contains(c_.public_key().id()));
  EXPECT_TRUE(result.findings.empty());
}

TEST_F(RootWalking, StopsBeforeARootThatTheOldKeysHaveNotSigned) {
  put(2, b_, {&b_});
  put(3, c_, {&b_, &c_});
  const RootSuccession result = walk();
  EXPECT_EQ(result.root.version, 1);
  EXPECT_TRUE(result.findings.refuses());
}

// The first root's key may not appoint the third: it has no say after the second.
TEST_F(RootWalking, RetiredKeyHasNoSayLaterOn) {
  put(2, b_, {&a_, &b_});
  put(3, c_, {&a_, &c_});
  const RootSuccession result = walk();
  EXPECT_EQ(result.root.version, 2);
  EXPECT_TRUE(result.findings.refuses());
}

TEST_F(RootWalking, RevokedKeyHasNoSay) {
  TrustRoot second = version(2, b_);
  second.revoked.insert(a_.public_key().id());
  documents_[2] = sign_root(second, {&a_, &b_}).json();
  put(3, a_, {&a_, &b_});
  const RootSuccession third = walk();
  EXPECT_EQ(third.root.version, 3) << "the second root's own key may bring another key in";
  put(3, a_, {&a_});
  EXPECT_EQ(walk().root.version, 2);
}

TEST_F(RootWalking, AnotherVersionUnderTheNameIsARollback) {
  documents_[2] = sign_root(version(1, a_), {&a_}).json();
  EXPECT_TRUE(walk().findings.contains("root.rollback"));
  documents_[2] = sign_root(version(3, a_), {&a_}).json();
  EXPECT_TRUE(walk().findings.contains("root.rollback"));
}

TEST_F(RootWalking, DamagedDocumentsAreFindings) {
  put(2, b_, {&a_, &b_});
  const std::string good = documents_[2];
  for (std::size_t at = 0; at < good.size(); at += 7) {
    documents_[2] = good;
    documents_[2][at] = static_cast<char>(documents_[2][at] ^ 1);
    const RootSuccession result = walk();
    if (result.root.version == 2) {
      // Blanks between the members are not signed; everything that is must be as it was.
      EXPECT_EQ(parse_root(documents_[2], "test").signed_bytes, parse_root(good, "test").signed_bytes) << at;
    } else {
      EXPECT_TRUE(result.findings.refuses()) << at;
    }
  }
  documents_[2].clear();
  EXPECT_TRUE(walk().findings.contains("root.invalid"));
}

}  // namespace
}  // namespace nadir
