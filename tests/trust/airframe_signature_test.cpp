#include "trust/signatures.hpp"

#include <gtest/gtest.h>

#include "trust/signed_document.hpp"

namespace nadir {
namespace {

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
    const std::string json = envelope_json({std::string(type), {sign_payload(key, type, as_bytes(text))}});
    return {json.begin(), json.end()};
  }
  Findings judged(const std::optional<Bytes>& envelope,
                  UnsignedAirframe without = refused_when_signers_are_known) const {
    return check_airframe(root_, as_bytes(kText), envelope, kNow, without, "airframe.json.sig");
  }
  void expect_refused(const std::optional<Bytes>& envelope, std::string_view code) const {
    for (const auto without : {refused_when_signers_are_known, allowed}) {
      const Findings findings = judged(envelope, without);
      EXPECT_TRUE(findings.refuses());
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

TEST_F(AirframeSignature, WithoutTheRoleThePackageSignersSign) {
  EXPECT_TRUE(judged(signed_by(planner_)).empty());
  expect_refused(signed_by(hangar_), "key.unknown");
  name_signers();
  expect_refused(signed_by(planner_), "key.unknown");
}

TEST_F(AirframeSignature, NoneIsAWarningUntilTheRootKnowsWhoSigns) {
  const Findings early = judged(std::nullopt);
  ASSERT_EQ(early.items().size(), 1U);
  EXPECT_EQ(early.items()[0].code, "airframe.unsigned");
  EXPECT_FALSE(early.refuses());
  name_signers();
  EXPECT_TRUE(judged(std::nullopt).refuses());
  const Findings bench = judged(std::nullopt, allowed);
  EXPECT_TRUE(bench.contains("airframe.unsigned")) << "said all the same";
  EXPECT_FALSE(bench.refuses());
}

// A false signature is no missing one: the bench does not accept it either.
TEST_F(AirframeSignature, FalseOnesAreRefusedEverywhere) {
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

TEST_F(AirframeSignature, AnExpiredKeySignsNoMore) {
  name_signers();
  root_.keys.at(hangar_.public_key().id()).expires = kNow;
  expect_refused(signed_by(hangar_), "key.expired");
}

}  // namespace
}  // namespace nadir
