#include "trust/rollback_permit.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "base/error.hpp"

namespace nadir {
namespace {

using nlohmann::json;

class Permit : public ::testing::Test {
 protected:
  Permit() {
    for (const PrivateKey* key : {&packer_, &second_}) {
      root_.add_key(key->public_key());
      root_.package_signer.key_ids.insert(key->public_key().id());
    }
  }
  SignedPermit make(std::optional<std::string> airframe = std::nullopt) const {
    return sign_permit({"valley", 8, 7, std::move(airframe), {2000}}, {&packer_});
  }

  PrivateKey packer_ = PrivateKey::generate(), second_ = PrivateKey::generate();
  TrustRoot root_;
  const RollbackRequest wish_{"valley", 8, 7, std::nullopt, {1000}};
};

TEST_F(Permit, AllowsExactlyWhatItNames) {
  EXPECT_TRUE(check_permit(parse_permit(make().document.json(), "test"), root_, wish_).empty());
  const std::vector<RollbackRequest> others{
      {"hills", 8, 7, std::nullopt, {1000}},
      {"valley", 9, 7, std::nullopt, {1000}},
      {"valley", 8, 6, std::nullopt, {1000}},
      {"valley", 8, 7, std::nullopt, {2000}},  // its last second has passed
  };
  for (std::size_t i = 0; i < others.size(); ++i) {
    EXPECT_TRUE(check_permit(make(), root_, others[i]).contains("permit.invalid")) << i;
  }
}

TEST_F(Permit, ForOneAirframeIsInvalidForOthers) {
  RollbackRequest wish = wish_;
  EXPECT_TRUE(check_permit(make("mini-07"), root_, wish).contains("permit.invalid")) << "no airframe was named";
  wish.airframe = "mini-08";
  EXPECT_TRUE(check_permit(make("mini-07"), root_, wish).contains("permit.invalid"));
  wish.airframe = "mini-07";
  EXPECT_TRUE(check_permit(make("mini-07"), root_, wish).empty());
  EXPECT_TRUE(check_permit(make(), root_, wish).empty()) << "a permit for all";
}

TEST_F(Permit, NeedsTheThresholdOfPackageSigners) {
  root_.package_signer.threshold = 2;
  SignedPermit permit = make();
  EXPECT_TRUE(check_permit(permit, root_, wish_).contains("signature.missing"));
  permit.document.put(sign_payload(second_, kPermitPayloadType, as_bytes(permit.document.signed_bytes)));
  EXPECT_TRUE(check_permit(permit, root_, wish_).empty());
  root_.revoked.insert(second_.public_key().id());
  EXPECT_TRUE(check_permit(permit, root_, wish_).has_errors());
}

TEST_F(Permit, IsRejectedWhenEditedOrOfAnotherAuthority) {
  json edited = json::parse(make().document.json());
  edited["signed"]["to"] = 6;
  RollbackRequest wish = wish_;
  wish.to = 6;
  EXPECT_TRUE(check_permit(parse_permit(edited.dump(), "test"), root_, wish).contains("signature.invalid"));
  const PrivateKey untrusted = PrivateKey::generate();
  EXPECT_TRUE(check_permit(sign_permit({"valley", 8, 7, std::nullopt, {2000}}, {&untrusted}), root_, wish_)
                  .contains("key.unknown"));
  // A signature over the same bytes as another kind of document.
  SignedPermit confused = make();
  confused.document.put(sign_payload(packer_, kRootPayloadType, as_bytes(confused.document.signed_bytes)));
  EXPECT_TRUE(check_permit(confused, root_, wish_).contains("signature.invalid"));
}

TEST_F(Permit, RejectsInvalidForms) {
  const std::vector<std::function<void(json&)>> edits{
      [](json& d) { d["extra"] = 1; },
      [](json& d) { d["signed"]["extra"] = 1; },
      [](json& d) { d["signed"].erase("series"); },
      [](json& d) { d["signed"]["schema"] = "nadir.rollback-permit/2"; },
      [](json& d) { d["signed"]["series"] = std::string(65, 'a'); },
      [](json& d) { d["signed"]["from"] = -1; },
      [](json& d) { d["signed"]["from"] = 8.0; },
      [](json& d) { d["signed"]["to"] = 8; },  // no step back
      [](json& d) { d["signed"]["to"] = "7"; },
      [](json& d) { d["signed"]["expires"] = "soon"; },
      [](json& d) { d["signed"]["airframe"] = nullptr; },
      [](json& d) { d["signatures"] = json::array(); },
      [](json& d) { d["signed"] = "text"; },
  };
  for (std::size_t i = 0; i < edits.size(); ++i) {
    json edited = json::parse(make().document.json());
    edits[i](edited);
    EXPECT_THROW(parse_permit(edited.dump(), "test"), Error) << "edit " << i;
  }
}

}  // namespace
}  // namespace nadir
