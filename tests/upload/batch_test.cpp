#include "upload/batch.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "ortho/sample_candidates.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using nlohmann::json;

class BatchDocument : public ::testing::Test {
 protected:
  Batch batch(std::uint32_t tiles) const {
    Batch batch;
    batch.id = "0f8b4a52-6c1e-4d0b-9a7e-3b5c2d1e0f9a";
    batch.created_at = {1'795'000'000};
    for (std::uint32_t i = 0; i < tiles; ++i) {
      Candidate candidate = test::sample_candidate(key_, {19, 278'000 + i, 182'000}, static_cast<int>(i));
      batch.tiles.push_back({candidate.sidecar, candidate.sidecar_bytes, candidate.signature});
    }
    batch.airframe = batch.tiles.at(0).sidecar.airframe;
    batch.flight = batch.tiles.at(0).sidecar.flight;
    batch.base_package = batch.tiles.at(0).sidecar.base_package;
    return batch;
  }
  TrustRoot root_for(const std::string& airframe, const PrivateKey& key) const {
    TrustRoot root;
    root.add_key(key.public_key());
    root.tile_signers[airframe].key_ids.insert(key.public_key().id());
    return root;
  }

  PrivateKey key_ = PrivateKey::generate(), other_ = PrivateKey::generate();
};

TEST_F(BatchDocument, RoundTripsAsSigned) {
  const SignedBatch made = sign_batch(batch(3), key_);
  const SignedBatch read = parse_batch(made.json(), "test");
  EXPECT_EQ(read.document.signed_bytes, made.document.signed_bytes);
  ASSERT_EQ(read.batch.tiles.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    const BatchTile& tile = read.batch.tiles[i];
    EXPECT_EQ(tile.sidecar, batch(3).tiles[i].sidecar);
    EXPECT_EQ(candidate_json(tile.sidecar), tile.sidecar_bytes);
    const auto check = check_candidate_signature(root_for(read.batch.airframe, key_), tile.sidecar, tile.sidecar_bytes,
                                                 tile.signature, std::nullopt);
    EXPECT_TRUE(check.findings.empty()) << "the tile's own signature survives the batch";
  }
  EXPECT_TRUE(check_batch_signature(root_for(read.batch.airframe, key_), read, std::nullopt).findings.empty());
}

TEST_F(BatchDocument, IsSignedByItsAirframe) {
  const SignedBatch made = sign_batch(batch(1), key_);
  const std::string airframe = made.batch.airframe;
  EXPECT_TRUE(check_batch_signature(root_for(airframe, other_), made, std::nullopt).findings.contains("key.unknown"));
  EXPECT_TRUE(check_batch_signature(root_for("another", key_), made, std::nullopt).findings.contains("key.unknown"));
  TrustRoot revoked = root_for(airframe, key_);
  revoked.revoked.insert(key_.public_key().id());
  EXPECT_TRUE(check_batch_signature(revoked, made, std::nullopt).findings.contains("key.revoked"));
  json document = json::parse(made.json());
  document["signed"]["created_at"] = "2026-01-01T00:00:00Z";
  const SignedBatch changed = parse_batch(document.dump(), "test");
  EXPECT_TRUE(
      check_batch_signature(root_for(airframe, key_), changed, std::nullopt).findings.contains("signature.invalid"));
}

TEST_F(BatchDocument, RejectsInvalidForms) {
  const std::string good = sign_batch(batch(2), key_).json();
  const std::vector<std::pair<const char*, std::function<void(json&)>>> damages{
      {"another schema", [](json& d) { d["signed"]["schema"] = "nadir.batch/2"; }},
      {"no UUID", [](json& d) { d["signed"]["batch"] = "../../etc/passwd"; }},
      {"an upper-case UUID", [](json& d) { d["signed"]["batch"] = "0F8B4A52-6C1E-4D0B-9A7E-3B5C2D1E0F9A"; }},
      {"another airframe than the tiles'", [](json& d) { d["signed"]["airframe"] = "another"; }},
      {"another flight than the tiles'", [](json& d) { d["signed"]["flight"] = "another"; }},
      {"another package than the tiles'", [](json& d) { d["signed"]["base_package"] = std::string(64, 'a'); }},
      {"a package that is no digest", [](json& d) { d["signed"]["base_package"] = "x"; }},
      {"a time in another spelling", [](json& d) { d["signed"]["created_at"] = "2026-01-01 00:00:00Z"; }},
      {"no tiles", [](json& d) { d["signed"]["tiles"] = json::array(); }},
      {"tiles that are no list", [](json& d) { d["signed"]["tiles"] = 7; }},
      {"a tile twice", [](json& d) { d["signed"]["tiles"][1] = d["signed"]["tiles"][0]; }},
      {"a tile without signature", [](json& d) { d["signed"]["tiles"][0].erase("sig"); }},
      {"a signature of 3 bytes", [](json& d) { d["signed"]["tiles"][0]["sig"] = "AAAA"; }},
      {"a keyid that is none", [](json& d) { d["signed"]["tiles"][0]["keyid"] = "me"; }},
      {"an unknown member", [](json& d) { d["signed"]["note"] = "hello"; }},
      {"an unknown member of a tile", [](json& d) { d["signed"]["tiles"][0]["note"] = "hello"; }},
      {"a sidecar with too much", [](json& d) { d["signed"]["tiles"][0]["sidecar"]["note"] = "hello"; }},
      {"a sidecar of another schema", [](json& d) { d["signed"]["tiles"][0]["sidecar"]["schema"] = "x"; }},
      {"no signatures", [](json& d) { d["signatures"] = json::array(); }},
      {"null", [](json& d) { d = nullptr; }},
      {"a member missing", [](json& d) { d["signed"].erase("flight"); }}};
  for (const auto& [what, damage] : damages) {
    json document = json::parse(good);
    damage(document);
    EXPECT_THROW(parse_batch(document.dump(), "test"), Error) << what;
  }
  EXPECT_NO_THROW(parse_batch(json::parse(good).dump(2), "test")) << "whitespace changes nothing";
}

TEST_F(BatchDocument, RejectsTruncationAndDuplicateMembers) {
  const std::string good = sign_batch(batch(1), key_).json();
  for (std::size_t size = 0; size < good.size(); size += 13) {
    EXPECT_THROW(parse_batch(good.substr(0, size), "test"), Error) << size;
  }
  std::string twice = good;
  twice.insert(twice.find("\"airframe\""), "\"airframe\":\"another\",");
  EXPECT_THROW(parse_batch(twice, "test"), Error);
  std::string deep = good;
  deep.insert(deep.find("\"airframe\""), "\"a\":" + std::string(1000, '[') + std::string(1000, ']') + ",");
  EXPECT_THROW(parse_batch(deep, "test"), Error);
  EXPECT_THROW(parse_batch(std::string((4U << 20) + 1, ' '), "test"), Error);
}

TEST_F(BatchDocument, LimitsApplyToWritersToo) {
  EXPECT_THROW(sign_batch(batch(2001), key_), Error);
  Batch twice = batch(2);
  twice.tiles[1] = twice.tiles[0];
  EXPECT_THROW(sign_batch(twice, key_), Error);
}

TEST_F(BatchDocument, ItsSizeIsKnownBeforeEncoding) {
  const Batch two = batch(2), three = batch(3);
  const std::uint64_t growth = sign_batch(three, key_).json().size() - sign_batch(two, key_).json().size();
  EXPECT_GE(batch_share(three.tiles[2]), growth);
  EXPECT_LE(batch_share(three.tiles[2]), growth + 20);
  EXPECT_LE(sign_batch(two, key_).json().size(), kBatchFrame + 2 * batch_share(two.tiles[0]) + 10);
}

TEST_F(BatchDocument, ParsesTheExampleOfTheContract) {
  const test::TemporaryFolder folder;
  const auto python =
      test::run_process({NADIR_PYTHON, "-c",
                         "import json,sys,yaml; c=yaml.safe_load(open(sys.argv[1])); "
                         "json.dump(c['components']['examples']['OneTile']['value'], open(sys.argv[2],'w'))",
                         std::string(NADIR_SCHEMAS) + "/candidates.openapi.yaml", (folder / "batch.json").string()});
  ASSERT_EQ(python.code, 0) << python.err;
  const SignedBatch example = parse_batch(read_text_file(folder / "batch.json"), "the example");
  EXPECT_EQ(example.batch.airframe, "mini-07");
  EXPECT_EQ(example.batch.tiles.at(0).sidecar.sha256, sha256(as_bytes("test")));
}

TEST(Uuid, HasVersionAndVariant) {
  std::array<std::uint8_t, 16> ones{};
  ones.fill(0xFF);
  EXPECT_EQ(uuid_from(ones), "ffffffff-ffff-4fff-bfff-ffffffffffff");
  EXPECT_EQ(uuid_from({}), "00000000-0000-4000-8000-000000000000");
  EXPECT_TRUE(is_uuid(uuid_from(ones)));
  for (const char* text : {"", "00000000-0000-4000-8000-00000000000", "00000000-0000-4000-8000-0000000000000",
                           "00000000_0000-4000-8000-000000000000", "0000000g-0000-4000-8000-000000000000"}) {
    EXPECT_FALSE(is_uuid(text)) << text;
  }
}

}  // namespace
}  // namespace nadir
