#include "trust/root.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr UtcTime kAcceptedAt{1'800'000'000};

class Root : public ::testing::Test {
 protected:
  static void give(TrustRoot& root, Role& role, const PrivateKey& key) {
    root.add_key(key.public_key());
    role.key_ids.insert(key.public_key().id());
  }
  TrustRoot version(std::int64_t number, const PrivateKey& root_key) const {
    TrustRoot root;
    root.version = number;
    root.expires = {2'000'000'000};
    give(root, root.root, root_key);
    give(root, root.package_signer, packer_);
    give(root, root.tile_signers["mini-07"], tiler_);
    return root;
  }
  json document() const { return json::parse(sign_root(version(1, first_), {&first_}).json()); }

  PrivateKey first_ = PrivateKey::generate(), second_ = PrivateKey::generate(), packer_ = PrivateKey::generate(),
             tiler_ = PrivateKey::generate();
};

TEST_F(Root, RoundTrips) {
  TrustRoot root = version(3, first_);
  root.revoked.insert(second_.public_key().id());
  root.keys.at(tiler_.public_key().id()).expires = UtcTime{1'900'000'000};
  const SignedRoot back = parse_root(sign_root(root, {&first_}).json(), "test");
  EXPECT_EQ(back.root.version, 3);
  EXPECT_EQ(back.root.expires, root.expires);
  EXPECT_EQ(back.root.revoked, root.revoked);
  EXPECT_EQ(back.root.package_signer.key_ids, root.package_signer.key_ids);
  EXPECT_EQ(back.root.tile_signers.at("mini-07").key_ids.count(tiler_.public_key().id()), 1U);
  EXPECT_FALSE(back.root.airframe_signer);
  root.airframe_signer = root.package_signer;
  EXPECT_EQ(parse_root(sign_root(root, {&first_}).json(), "test").root.airframe_signer->key_ids,
            root.package_signer.key_ids);
  EXPECT_EQ(back.root.keys.at(tiler_.public_key().id()).expires, UtcTime{1'900'000'000});
  EXPECT_TRUE(check_self(back).empty());
}

TEST_F(Root, RejectsUnsignedContent) {
  const test::TemporaryFolder folder;
  const auto good = folder.write("root.json", document().dump());
  EXPECT_EQ(read_trusted_root(good).version, 1);
  json edited = document();
  edited["signed"]["expires"] = "2099-01-01T00:00:00Z";
  EXPECT_THROW(read_trusted_root(folder.write("edited.json", edited.dump())), Error);
  json untrusted = document();
  untrusted["signatures"] = json::parse(sign_root(version(1, second_), {&second_}).json())["signatures"];
  EXPECT_THROW(read_trusted_root(folder.write("untrusted.json", untrusted.dump())), Error);
}

// Layout of the file does not matter, its content does.
TEST_F(Root, IsIndependentOfWhitespace) {
  const test::TemporaryFolder folder;
  EXPECT_EQ(read_trusted_root(folder.write("root.json", document().dump(7))).version, 1);
}

TEST_F(Root, RejectsInvalidForms) {
  const std::vector<std::function<void(json&)>> edits{
      [](json& d) { d.erase("signatures"); },
      [](json& d) { d["extra"] = 1; },
      [](json& d) { d["signed"]["extra"] = 1; },
      [](json& d) { d["signed"]["schema"] = "nadir.root/2"; },
      [](json& d) { d["signed"]["version"] = 0; },
      [](json& d) { d["signed"]["version"] = -1; },
      [](json& d) { d["signed"]["version"] = 1.5; },
      [](json& d) { d["signed"]["expires"] = "soon"; },
      [](json& d) { d["signed"]["keys"].begin().value()["algorithm"] = "none"; },
      [](json& d) { d["signed"]["keys"].begin().value()["public"] = "AAAA"; },
      [](json& d) { d["signed"]["keys"].erase(d["signed"]["keys"].begin()); },
      [](json& d) { d["signed"]["roles"]["root"]["threshold"] = 0; },
      [](json& d) { d["signed"]["roles"]["root"]["threshold"] = 2; },  // more than there are keys
      [](json& d) { d["signed"]["roles"].erase("root"); },
      [](json& d) { d["signed"]["roles"]["admin"] = d["signed"]["roles"]["root"]; },
      [](json& d) { d["signed"]["revoked"] = "none"; },
      [](json& d) { d["signed"]["revoked"] = {"abc"}; },
      [](json& d) {
        auto& ids = d["signed"]["roles"]["root"]["keyids"];
        ids.push_back(ids[0]);
      },
  };
  for (std::size_t i = 0; i < edits.size(); ++i) {
    json edited = document();
    edits[i](edited);
    EXPECT_THROW(parse_root(edited.dump(), "test"), Error) << "edit " << i;
  }
}

// A key whose id does not follow from it could pass under a revoked key's name.
TEST_F(Root, RejectsKeysUnderAnotherKeysId) {
  json edited = document();
  json& keys = edited["signed"]["keys"];
  const std::string own = first_.public_key().id(), other = packer_.public_key().id();
  keys[own]["public"] = keys[other]["public"];
  EXPECT_THROW(parse_root(edited.dump(), "test"), Error);
}

TEST_F(Root, SuccessorNeedsSignaturesOfOldAndNewKeys) {
  const TrustRoot now = version(1, first_);
  const TrustRoot next = version(2, second_);
  EXPECT_TRUE(check_succession(now, sign_root(next, {&first_, &second_}), kAcceptedAt).empty());
  EXPECT_TRUE(check_succession(now, sign_root(next, {&second_}), kAcceptedAt).contains("signature.missing"));
  EXPECT_TRUE(check_succession(now, sign_root(next, {&first_}), kAcceptedAt).contains("signature.missing"));
}

TEST_F(Root, SuccessorIsTheNextVersion) {
  const TrustRoot now = version(5, first_);
  for (const std::int64_t number : {1, 4, 5, 7}) {
    EXPECT_TRUE(
        check_succession(now, sign_root(version(number, first_), {&first_}), kAcceptedAt).contains("root.rollback"))
        << number;
  }
  EXPECT_FALSE(check_succession(now, sign_root(version(6, first_), {&first_}), kAcceptedAt).has_errors());
}

// A revoked root key does not count in the succession.
TEST_F(Root, RevokedRootKeyCannotAppoint) {
  TrustRoot now = version(1, first_);
  now.revoked.insert(first_.public_key().id());
  EXPECT_TRUE(check_succession(now, sign_root(version(2, second_), {&first_, &second_}), kAcceptedAt).has_errors());
}

TEST_F(Root, RootWithoutItsOwnSignaturesIsNotTrusted) {
  EXPECT_TRUE(check_self(sign_root(version(1, first_), {&packer_})).has_errors());
}

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
  RootSuccession walk(std::int64_t from = 1, bool accepted_earlier = false) {
    return follow_root_chain(
        version(from, a_),
        [this, accepted_earlier](std::int64_t wanted) -> std::optional<RootDocument> {
          const auto found = documents_.find(wanted);
          if (found == documents_.end()) return std::nullopt;
          return RootDocument{found->second, "test", accepted_earlier};
        },
        kAcceptedAt);
  }

  PrivateKey a_ = PrivateKey::generate(), b_ = PrivateKey::generate(), c_ = PrivateKey::generate();
  std::map<std::int64_t, std::string> documents_;
};

TEST_F(RootWalking, WithoutNewerRootsKeepsTheCurrentOne) {
  const RootSuccession result = walk();
  EXPECT_EQ(result.root.version, 1);
  EXPECT_TRUE(result.newer.empty());
  EXPECT_TRUE(result.findings.empty());
}

TEST_F(RootWalking, FollowsEveryVersionWithNewKeys) {
  put(2, b_, {&a_, &b_});
  put(3, c_, {&b_, &c_});
  const RootSuccession result = walk();
  EXPECT_EQ(result.root.version, 3);
  EXPECT_EQ(result.newer.size(), 2U);
  EXPECT_TRUE(result.root.root.key_ids.contains(c_.public_key().id()));
  EXPECT_TRUE(result.findings.empty());
}

TEST_F(RootWalking, StopsBeforeARootNotSignedByTheOldKeys) {
  put(2, b_, {&b_});
  put(3, c_, {&b_, &c_});
  const RootSuccession result = walk();
  EXPECT_EQ(result.root.version, 1);
  EXPECT_TRUE(result.findings.has_errors());
}

// The first root's key may not appoint the third: it has no say after the second.
TEST_F(RootWalking, RetiredKeyCannotSignLaterRoots) {
  put(2, b_, {&a_, &b_});
  put(3, c_, {&a_, &c_});
  const RootSuccession result = walk();
  EXPECT_EQ(result.root.version, 2);
  EXPECT_TRUE(result.findings.has_errors());
}

TEST_F(RootWalking, RevokedKeyCannotSign) {
  TrustRoot second = version(2, b_);
  second.revoked.insert(a_.public_key().id());
  documents_[2] = sign_root(second, {&a_, &b_}).json();
  put(3, a_, {&a_, &b_});
  const RootSuccession third = walk();
  EXPECT_EQ(third.root.version, 3) << "the second root's own key may bring another key in";
  put(3, a_, {&a_});
  EXPECT_EQ(walk().root.version, 2);
}

// A key with a date of its own appoints until then, by the clock of the moment at which the new root is accepted: a
// root does not prove when it was signed.
TEST_F(RootWalking, AnExpiredRootKeyCannotAppoint) {
  TrustRoot next = version(2, b_);
  documents_[2] = sign_root(next, {&a_, &b_}).json();
  const auto walked = [this](std::optional<UtcTime> expires_a, UtcTime at, bool accepted_earlier = false) {
    TrustRoot trusted = version(1, a_);
    trusted.keys.at(a_.public_key().id()).expires = expires_a;
    return follow_root_chain(
        trusted,
        [&](std::int64_t wanted) -> std::optional<RootDocument> {
          if (wanted != 2) return std::nullopt;
          return RootDocument{documents_[2], "test", accepted_earlier};
        },
        at);
  };
  const UtcTime before{kAcceptedAt.unix_s - 1};
  EXPECT_EQ(walked(std::nullopt, kAcceptedAt).root.version, 2);
  EXPECT_EQ(walked(kAcceptedAt, before).root.version, 2) << "still valid when it is accepted";
  const RootSuccession late = walked(kAcceptedAt, kAcceptedAt);
  EXPECT_EQ(late.root.version, 1);
  ASSERT_TRUE(late.findings.contains("key.expired"));
  EXPECT_EQ(late.findings.items().front().where, "root version 2");
  EXPECT_NE(late.findings.items().front().fix.find("clock"), std::string::npos);
  EXPECT_EQ(walked(kAcceptedAt, kAcceptedAt, true).root.version, 2) << "what was accepted in time stays accepted";
  // An expired key of the new root does not vouch for it either.
  next.keys.at(b_.public_key().id()).expires = before;
  documents_[2] = sign_root(next, {&a_, &b_}).json();
  EXPECT_TRUE(walked(std::nullopt, kAcceptedAt).findings.contains("key.expired"));
}

TEST_F(RootWalking, AnExpiredKeyDoesNotCountTowardsTheThreshold) {
  TrustRoot trusted = version(1, a_);
  trusted.add_key(b_.public_key());
  trusted.root.key_ids.insert(b_.public_key().id());
  trusted.keys.at(a_.public_key().id()).expires = kAcceptedAt;
  const SignedRoot both = sign_root(version(2, c_), {&a_, &b_, &c_});
  const Findings one_is_enough = check_succession(trusted, both, kAcceptedAt);
  EXPECT_FALSE(one_is_enough.has_errors());
  EXPECT_TRUE(one_is_enough.contains("key.expired")) << "as a warning";
  trusted.root.threshold = 2;
  EXPECT_TRUE(check_succession(trusted, both, kAcceptedAt).has_errors());
}

TEST_F(RootWalking, AnotherVersionUnderThisNameIsARollback) {
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
      EXPECT_TRUE(result.findings.has_errors()) << at;
    }
  }
  documents_[2].clear();
  EXPECT_TRUE(walk().findings.contains("root.invalid"));
}

}  // namespace

}  // namespace nadir
