// Roots carried by packages: an offline aircraft learns of new keys, and accepts no false ones.
#include "package/package_roots.hpp"

#include <gtest/gtest.h>

#include "package/package_writer.hpp"
#include "package/verify_fixture.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using test::codes;
using test::PackageMaker;
using test::Verify;

class CarriedRoots : public Verify {
 protected:
  // The maker's root gets a root key of its own; the second version names another package signer.
  CarriedRoots() {
    maker_.root.root.key_ids = {root_key_.public_key().id()};
    maker_.root.add_key(root_key_.public_key());
    second_ = maker_.root;
    second_.version = 2;
    second_.keys.erase(maker_.signer.public_key().id());
    second_.revoked = {maker_.signer.public_key().id()};
    second_.add_key(new_signer_.public_key());
    second_.package_signer.key_ids = {new_signer_.public_key().id()};
  }
  void carry(const fs::path& package, const TrustRoot& root, const std::vector<const PrivateKey*>& keys) {
    const fs::path file = folder_ / "carried.json";
    write_file_atomic(file, sign_root(root, keys).json());
    add_package_roots(package, read_root_chain(std::vector{file}, test::kJudged, roots_in_package(Directory(package))));
  }
  fs::path rotated(const std::string& name = "rotated") {
    const fs::path package = maker_.make(folder_, name);
    sign_package(package, new_signer_);
    carry(package, second_, {&root_key_});
    return package;
  }

  PrivateKey root_key_ = PrivateKey::generate(), new_signer_ = PrivateKey::generate();
  TrustRoot second_;
};

TEST_F(CarriedRoots, AnOfflineAircraftWalksToTheNextRoot) {
  const Verification result = maker_.verify(rotated(), VerifyDepth::full);
  EXPECT_TRUE(result.accepted()) << codes(result.findings);
  EXPECT_EQ(result.root_version, 2);
  EXPECT_EQ(result.signers, std::vector{new_signer_.public_key().id()});
}

TEST_F(CarriedRoots, WithoutTheNewRootItsKeyIsUnknown) {
  const fs::path package = rotated();
  fs::remove_all(package / kRootFolder);
  expect_only("key.unknown", maker_.verify(package));
}

TEST_F(CarriedRoots, RevocationTakesEffectWithThePackageThatBringsIt) {
  const fs::path package = maker_.make(folder_);  // signed by the key that the second root revokes
  EXPECT_TRUE(maker_.verify(package).accepted());
  carry(package, second_, {&root_key_});
  expect_only("key.revoked", maker_.verify(package));
}

TEST_F(CarriedRoots, TheStateRemembersTheRoot) {
  AircraftState state;
  VerifyOptions options = maker_.options();
  options.state = &state;
  const fs::path old = maker_.make(folder_, "old");
  const fs::path bare = maker_.make(folder_, "bare");
  sign_package(bare, new_signer_);
  EXPECT_TRUE(with_options(old, options).accepted());
  const Verification first = with_options(rotated(), options);
  ASSERT_TRUE(first.accepted()) << codes(first.findings);
  remember(state, first, options.at);
  write_state(folder_ / "state.json", state);
  state = read_state(folder_ / "state.json");
  EXPECT_EQ(state.root_version, 2);
  // From now on the revoked key is dead, and packages of the new one need not carry the root again.
  expect_only("key.revoked", with_options(old, options));
  EXPECT_TRUE(with_options(bare, options).accepted()) << codes(with_options(bare, options).findings);
  // A state without the document knows only that there was a newer root.
  state.roots.clear();
  expect_only("root.rollback", with_options(old, options));
}

// The clock of accepting counts: too late for an aircraft that does not have the new root, of no concern for one
// that accepted it in time.
TEST_F(CarriedRoots, AnExpiredRootKeyAppointsOnlyWhereItWasAcceptedInTime) {
  const fs::path package = rotated();
  VerifyOptions options = maker_.options();
  TrustRoot trusted = *options.root;
  trusted.keys.at(root_key_.public_key().id()).expires = UtcTime{options.at.unix_s + 60};
  options.root = &trusted;
  AircraftState in_time, late;
  options.state = &in_time;
  const Verification first = with_options(package, options);
  ASSERT_TRUE(first.accepted()) << codes(first.findings);
  remember(in_time, first, options.at);
  options.at.unix_s += 61;
  EXPECT_TRUE(with_options(package, options).accepted()) << codes(with_options(package, options).findings);
  options.state = &late;
  const Verification second = with_options(package, options);
  EXPECT_FALSE(second.accepted());
  EXPECT_TRUE(second.findings.contains("key.expired")) << codes(second.findings);
  EXPECT_EQ(second.root_version, 1);
}

TEST_F(CarriedRoots, ARootOfAnExpiredKeyIsNotPutIntoAPackage) {
  const fs::path next = folder_ / "2.json";
  TrustRoot trusted = maker_.root;
  trusted.keys.at(root_key_.public_key().id()).expires = test::kJudged;
  write_file_atomic(next, sign_root(second_, {&root_key_}).json());
  const UtcTime before{test::kJudged.unix_s - 1};
  EXPECT_EQ(read_root_chain(std::vector{next}, before, {}, &trusted).size(), 1U);
  EXPECT_THROW(read_root_chain(std::vector{next}, test::kJudged, {}, &trusted), UsageError);
}

// Whoever can write the state cannot appoint a root of his own: its signatures are checked again each time.
TEST_F(CarriedRoots, TheStateCannotAppointSigners) {
  const PrivateKey attacker = PrivateKey::generate();
  AircraftState state;
  state.roots[2] = sign_root(second_, {&attacker}).json();
  VerifyOptions options = maker_.options();
  options.state = &state;
  EXPECT_FALSE(with_options(maker_.make(folder_), options).accepted());
}

TEST_F(CarriedRoots, InvalidRootsRejectThePackage) {
  const PrivateKey attacker = PrivateKey::generate();
  TrustRoot false_root = second_;
  false_root.add_key(attacker.public_key());
  false_root.root.key_ids = {attacker.public_key().id()};
  const fs::path package = maker_.make(folder_);
  carry(package, false_root, {&attacker});
  expect("signature.missing", maker_.verify(package));
}

TEST_F(CarriedRoots, NamesAMissingIntermediateRoot) {
  const fs::path package = rotated();
  fs::rename(package / root_file_name(2), package / root_file_name(3));
  expect("root.rollback", maker_.verify(package));
}

TEST_F(CarriedRoots, IgnoresOlderRoots) {
  const fs::path package = rotated();
  VerifyOptions options = maker_.options();
  options.root = &second_;
  EXPECT_TRUE(with_options(package, options).accepted()) << codes(with_options(package, options).findings);
}

TEST_F(CarriedRoots, DamageAndOversizedRootsAreFindings) {
  const fs::path package = rotated();
  fs::resize_file(package / root_file_name(2), std::uintmax_t{1} << 40);  // sparse; must not be read
  expect("root.invalid", maker_.verify(package));
  overwrite(package / root_file_name(2), {'{', '}'});
  expect("root.invalid", maker_.verify(package));
}

TEST_F(CarriedRoots, OtherFilesAndLinksInTheFolderAreUnexpected) {
  for (const char* name :
       {"root/x", "root/02.root.json", "root/0.root.json", "root/2.root.json.sig", "root/a/2.root.json"}) {
    const fs::path package = maker_.make(folder_, "package");
    fs::create_directories((package / name).parent_path());
    write_file_atomic(package / name, "{}");
    expect_only("artifact.unexpected", maker_.verify(package));
    fs::remove_all(package);
  }
  const fs::path package = rotated("linked");
  fs::rename(package / root_file_name(2), folder_ / "outside.json");
  fs::create_symlink(folder_ / "outside.json", package / root_file_name(2));
  EXPECT_FALSE(maker_.verify(package).accepted());
}

TEST_F(CarriedRoots, TheNewRootMayHaveExpired) {
  second_.expires = test::kJudged;
  expect_only("key.expired", maker_.verify(rotated()));
}

TEST_F(Verify, RollbackWithAPermit) {
  const fs::path package = maker_.make(folder_);  // sequence 3
  AircraftState state;
  state.accept("village", 4, 1, {0});
  const UtcTime later{test::kJudged.unix_s + 1000};
  const SignedPermit permit = sign_permit({"village", 4, 3, std::nullopt, later}, {&maker_.signer});
  const SignedPermit other = sign_permit({"village", 5, 3, std::nullopt, later}, {&maker_.signer});
  VerifyOptions options = maker_.options();
  options.state = &state;
  expect_only("package.rollback", with_options(package, options));
  options.permit = &other;
  expect("permit.invalid", with_options(package, options));
  options.permit = &permit;
  const Verification result = with_options(package, options);
  EXPECT_TRUE(result.accepted()) << codes(result.findings);
  EXPECT_TRUE(result.findings.contains("package.rollback")) << "as a warning";
  remember(state, result, options.at);
  EXPECT_EQ(state.highest_sequence.at("village"), 4) << "the memory does not go down";
  options.at = later;
  expect("permit.invalid", with_options(package, options));
}

// An old package that is still what was signed: its own date, its root's date and the aircraft's clock end it.
TEST_F(Verify, FreezeEndsWithTheDates) {
  const fs::path package = maker_.make(folder_);
  VerifyOptions options = maker_.options();
  options.at = parse_utc("2024-07-01").value();
  expect("package.expired", with_options(package, options));
  maker_.root.expires = parse_utc("2024-05-20").value();
  options.at = parse_utc("2024-05-25").value();
  expect_only("key.expired", with_options(package, options));
  AircraftState state;
  state.accept("x", 1, 1, options.at);
  options = maker_.options();  // the clock goes back to when all was good
  options.state = &state;
  expect_only("time.untrusted", with_options(package, options));
}

TEST_F(Verify, TwoSignersMeetAThresholdOfTwo) {
  const PrivateKey second = PrivateKey::generate();
  maker_.root.add_key(second.public_key());
  maker_.root.package_signer.key_ids.insert(second.public_key().id());
  maker_.root.package_signer.threshold = 2;
  const fs::path package = maker_.make(folder_);
  EXPECT_EQ(add_package_signature(package, maker_.signer), 1U) << "the same key replaces its own";
  expect_only("signature.missing", maker_.verify(package));
  EXPECT_EQ(add_package_signature(package, second), 2U);
  EXPECT_TRUE(maker_.verify(package, VerifyDepth::full).accepted());
}

}  // namespace
}  // namespace nadir
