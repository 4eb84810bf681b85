#include "trust/signatures.hpp"

#include <gtest/gtest.h>

#include "trust/aircraft_state.hpp"
#include "trust/signed_document.hpp"

namespace nadir {
namespace {

class Signatures : public ::testing::Test {
 protected:
  Signatures() {
    for (const PrivateKey* key : {&a_, &b_, &root_key_}) root_.add_key(key->public_key());
    root_.package_signer.key_ids = {a_.public_key().id(), b_.public_key().id()};
    root_.root.key_ids = {root_key_.public_key().id()};
  }

  SignatureCheck check(const std::vector<EnvelopeSignature>& signatures, std::string_view body = "body",
                       UtcTime at = {1000}) const {
    return check_signatures(root_, root_.package_signer, signatures, "type", as_bytes(body), at, "test");
  }
  static EnvelopeSignature by(const PrivateKey& key) { return sign_payload(key, "type", as_bytes("body")); }

  PrivateKey a_ = PrivateKey::generate(), b_ = PrivateKey::generate(), root_key_ = PrivateKey::generate(),
             stranger_ = PrivateKey::generate();
  TrustRoot root_;
};

TEST_F(Signatures, AcceptsATrustedKey) {
  const SignatureCheck result = check({by(a_)});
  EXPECT_TRUE(result.findings.empty());
  EXPECT_EQ(result.signers, std::vector{a_.public_key().id()});
}

TEST_F(Signatures, RejectsOtherBytes) {
  EXPECT_TRUE(check({by(a_)}, "bodY").findings.contains("signature.invalid"));
  EXPECT_TRUE(check({sign_payload(a_, "another type", as_bytes("body"))}).findings.contains("signature.invalid"));
}

TEST_F(Signatures, RejectsUnknownKeys) {
  const SignatureCheck result = check({by(stranger_)});
  EXPECT_TRUE(result.findings.has_errors());
  EXPECT_TRUE(result.findings.contains("key.unknown"));
}

// A known key may not do what its role does not say.
TEST_F(Signatures, RejectsKeysOfAnotherRole) { EXPECT_TRUE(check({by(root_key_)}).findings.contains("key.unknown")); }

TEST_F(Signatures, RejectsRevokedAndExpiredKeys) {
  root_.revoked.insert(a_.public_key().id());
  EXPECT_TRUE(check({by(a_)}).findings.contains("key.revoked"));
  EXPECT_TRUE(check({by(a_)}).findings.has_errors());
  root_.keys.at(b_.public_key().id()).expires = UtcTime{1000};
  EXPECT_TRUE(check({by(b_)}).findings.contains("key.expired"));
  EXPECT_TRUE(check({by(b_)}, "body", {999}).findings.empty());
}

TEST_F(Signatures, ThresholdCountsKeysOnce) {
  root_.package_signer.threshold = 2;
  EXPECT_TRUE(check({by(a_)}).findings.contains("signature.missing"));
  EXPECT_TRUE(check({by(a_), by(a_)}).findings.contains("signature.missing"));
  EXPECT_FALSE(check({by(a_), by(b_)}).findings.has_errors());
  EXPECT_TRUE(check({by(a_), by(stranger_)}).findings.has_errors());
}

TEST_F(Signatures, BeyondTheThresholdUnknownKeysAreAWarning) {
  const SignatureCheck result = check({by(a_), by(stranger_)});
  EXPECT_FALSE(result.findings.has_errors());
  EXPECT_TRUE(result.findings.contains("key.unknown"));
}

TEST_F(Signatures, ADamagedSignatureIsAlwaysAnError) {
  EnvelopeSignature damaged = by(b_);
  damaged.signature[10] ^= 1;
  EXPECT_TRUE(check({by(a_), damaged}).findings.has_errors());
}

TEST_F(Signatures, NoSignaturesAreNotEnough) { EXPECT_TRUE(check({}).findings.contains("signature.missing")); }

// What one airframe signs with says nothing about the tiles of another, nor about packages.
TEST_F(Signatures, TileSignersBelongToOneAirframe) {
  const PrivateKey seven = PrivateKey::generate(), eight = PrivateKey::generate();
  TrustRoot root = root_;
  for (const auto& [airframe, key] : {std::pair{"mini-07", &seven}, std::pair{"mini-08", &eight}}) {
    root.add_key(key->public_key());
    root.tile_signers[airframe].key_ids.insert(key->public_key().id());
  }
  const Bytes body{1, 2, 3};
  const auto tile = [&](const std::string& airframe, const PrivateKey& key) {
    return check_tile_signatures(root, airframe, {sign_payload(key, "tile", body)}, "tile", body, std::nullopt, "tile")
        .findings;
  };
  EXPECT_TRUE(tile("mini-07", seven).empty());
  EXPECT_TRUE(tile("mini-08", seven).contains("key.unknown"));
  EXPECT_TRUE(tile("mini-09", seven).contains("key.unknown"));
  EXPECT_TRUE(check_signatures(root, root.package_signer, {sign_payload(seven, "tile", body)}, "tile", body,
                               std::nullopt, "package")
                  .findings.contains("key.unknown"));
  root.revoked.insert(seven.public_key().id());
  EXPECT_TRUE(tile("mini-07", seven).contains("key.revoked"));
  // As nadir keys revoke leaves it when this was the airframe's only key.
  root.tile_signers.erase("mini-07");
  root.keys.erase(seven.public_key().id());
  EXPECT_TRUE(tile("mini-07", seven).contains("key.revoked"));
  EXPECT_TRUE(tile("mini-07", eight).contains("key.unknown"));
}

constexpr UtcTime kNow{1'700'000'000};
constexpr std::string_view kText = R"({"airframe": "falcon-7"})";
using enum UnsignedAirframe;

class AirframeSignature : public ::testing::Test {
 protected:
  AirframeSignature() {
    root_.add_key(planner_.public_key());
    root_.add_key(hangar_.public_key());
    root_.package_signer.key_ids = {planner_.public_key().id()};
  }
  void name_signers() { root_.airframe_signer = Role{{hangar_.public_key().id()}, 1}; }

  static Bytes signed_by(const PrivateKey& key, std::string_view text = kText,
                         std::string_view type = kAirframePayloadType) {
    const std::string envelope = envelope_json({std::string(type), {sign_payload(key, type, as_bytes(text))}});
    return {envelope.begin(), envelope.end()};
  }
  Findings judged(const std::optional<Bytes>& envelope,
                  UnsignedAirframe without = refused_when_signers_are_known) const {
    return check_airframe(root_, as_bytes(kText), envelope, kNow, without, "airframe.json.sig");
  }
  void expect_refused(const std::optional<Bytes>& envelope, std::string_view code) const {
    for (const auto without : {refused_when_signers_are_known, allowed}) {
      const Findings findings = judged(envelope, without);
      EXPECT_TRUE(findings.has_errors());
      ASSERT_FALSE(findings.empty());
      EXPECT_EQ(findings.items()[0].code, code);
      EXPECT_EQ(findings.items()[0].where, "airframe.json.sig");
    }
  }

  PrivateKey planner_ = PrivateKey::generate(), hangar_ = PrivateKey::generate(), stranger_ = PrivateKey::generate();
  TrustRoot root_;
};

TEST_F(AirframeSignature, ByItsSignersIsAccepted) {
  name_signers();
  EXPECT_TRUE(judged(signed_by(hangar_)).empty());
}

TEST_F(AirframeSignature, WithoutTheRolePackageSignersApply) {
  EXPECT_TRUE(judged(signed_by(planner_)).empty());
  expect_refused(signed_by(hangar_), "key.unknown");
  name_signers();
  expect_refused(signed_by(planner_), "key.unknown");
}

TEST_F(AirframeSignature, MissingIsAWarningUntilTheRootNamesSigners) {
  const Findings early = judged(std::nullopt);
  ASSERT_EQ(early.items().size(), 1U);
  EXPECT_EQ(early.items()[0].code, "airframe.unsigned");
  EXPECT_FALSE(early.has_errors());
  name_signers();
  EXPECT_TRUE(judged(std::nullopt).has_errors());
  const Findings bench = judged(std::nullopt, allowed);
  EXPECT_TRUE(bench.contains("airframe.unsigned")) << "said all the same";
  EXPECT_FALSE(bench.has_errors());
}

// A false signature is no missing one: the bench does not accept it either.
TEST_F(AirframeSignature, InvalidIsAlwaysRejected) {
  name_signers();
  expect_refused(signed_by(stranger_), "key.unknown");
  expect_refused(signed_by(hangar_, "{}"), "signature.invalid");
  expect_refused(signed_by(hangar_, kText, "application/vnd.nadir.manifest.v1+json"), "signature.invalid");
  expect_refused(Bytes(), "signature.invalid");
  expect_refused(Bytes(100, 0xff), "signature.invalid");
  Bytes cut = signed_by(hangar_);
  cut.resize(cut.size() / 2);
  expect_refused(cut, "signature.invalid");
  root_.revoked.insert(hangar_.public_key().id());
  expect_refused(signed_by(hangar_), "key.revoked");
}

TEST_F(AirframeSignature, ByAnExpiredKeyIsRejected) {
  name_signers();
  root_.keys.at(hangar_.public_key().id()).expires = kNow;
  expect_refused(signed_by(hangar_), "key.expired");
}

class AirframeAge : public ::testing::Test {
 protected:
  Findings judged(std::optional<std::int64_t> sequence, std::optional<UtcTime> expires,
                  const AircraftState* state) const {
    return check_airframe_age({"falcon-7", sequence, expires}, state, kNow, "airframe.json");
  }
  const UtcTime later_{kNow.unix_s + 1};
};

TEST_F(AirframeAge, AnEarlierFileIsARollback) {
  AircraftState state;
  state.accept_airframe("falcon-7", 4);
  state.accept_airframe("other", 9);
  EXPECT_TRUE(judged(4, later_, &state).empty()) << "the same one, at every start";
  EXPECT_TRUE(judged(5, later_, &state).empty());
  EXPECT_TRUE(judged(1, later_, nullptr).empty()) << "without memory";
  const Findings older = judged(3, later_, &state);
  ASSERT_EQ(older.items().size(), 1U);
  EXPECT_TRUE(older.has_errors());
  EXPECT_EQ(older.items()[0].code, "airframe.rollback");
  EXPECT_EQ(older.items()[0].found, "sequence 3");
  EXPECT_NE(older.items()[0].fix.find("--sequence 5"), std::string::npos);
}

// The files of before sequences existed are the earliest of all.
TEST_F(AirframeAge, AFileWithoutASequenceIsEarlierThanAnyWithOne) {
  AircraftState state;
  EXPECT_FALSE(judged(std::nullopt, later_, &state).has_errors());
  state.accept_airframe("falcon-7", 1);
  EXPECT_TRUE(judged(std::nullopt, later_, &state).contains("airframe.rollback"));
  EXPECT_TRUE(judged(std::nullopt, later_, &state).has_errors());
}

TEST_F(AirframeAge, AnExpiredFileIsRejected) {
  EXPECT_TRUE(judged(1, later_, nullptr).empty());
  const Findings expired = judged(1, kNow, nullptr);
  EXPECT_TRUE(expired.has_errors());
  ASSERT_TRUE(expired.contains("airframe.expired"));
  EXPECT_NE(expired.items()[0].fix.find("clock"), std::string::npos);
}

TEST_F(AirframeAge, OlderFilesGiveAWarning) {
  for (const auto& [sequence, expires] : {std::pair{std::optional<std::int64_t>(), std::optional<UtcTime>()},
                                          {1, std::nullopt},
                                          {std::nullopt, later_}}) {
    const Findings findings = judged(sequence, expires, nullptr);
    EXPECT_FALSE(findings.has_errors());
    EXPECT_TRUE(findings.contains("airframe.undated"));
  }
}

}  // namespace

}  // namespace nadir
