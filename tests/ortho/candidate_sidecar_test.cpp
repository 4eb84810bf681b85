#include "ortho/candidate_sidecar.hpp"

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

constexpr TileKey kKey{19, 278'000, 182'000};

TEST(CandidateSidecar, RoundTrips) {
  CandidateSidecar sidecar = test::sample_sidecar(kKey);
  EXPECT_EQ(parse_candidate(candidate_json(sidecar), "test"), sidecar);
  sidecar.format = ImageFormat::webp;
  sidecar.trust = CandidateTrust::soft;
  sidecar.pose.refined = false;
  EXPECT_EQ(parse_candidate(candidate_json(sidecar), "test"), sidecar);
}

CandidateSidecar pieced_sidecar() {
  CandidateSidecar sidecar = test::sample_sidecar(kKey);
  sidecar.seam_mm = 700;
  for (int i = 0; i < 3; ++i) {
    CandidatePart& part = sidecar.parts.emplace_back();
    part = {"frame_" + std::to_string(i), {sidecar.captured_at.unix_ms + 500 * i}, 333'333, sidecar.pose};
    part.pose.sigma_mm -= 100 * i;
  }
  return sidecar;
}

TEST(CandidateSidecar, OfAMosaicRoundTrips) {
  EXPECT_EQ(parse_candidate(candidate_json(pieced_sidecar()), "test"), pieced_sidecar());
  EXPECT_EQ(json::parse(candidate_json(pieced_sidecar()))["schema"], "nadir.candidate/2");
  CandidateSidecar longest = pieced_sidecar();
  longest.parts.resize(kMaxCandidateParts, longest.parts[0]);
  for (CandidatePart& part : longest.parts) part.frame = std::string(128, 'f'), part.share_ppm = 166'667;
  longest.frame = std::string(128, 'f');
  longest.airframe = longest.flight = std::string(64, 'a');
  EXPECT_EQ(parse_candidate(candidate_json(longest), "test"), longest) << "there is room for the longest names";
}

TEST(CandidateSidecar, OfAMosaicStatesTheWorstOfItsParts) {
  const std::vector<std::function<void(json&)>> edits{
      [](json& d) { d.erase("parts"); },
      [](json& d) { d.erase("seam_mm"); },
      [](json& d) { d["schema"] = "nadir.candidate/1"; },
      [](json& d) { d["schema"] = "nadir.candidate/3"; },
      [](json& d) { d["parts"] = json::array(); },
      [](json& d) { d["parts"] = json::array({d["parts"][0]}); },
      [](json& d) {
        d["parts"] = json::object({{"0", d["parts"][0]}, {"1", d["parts"][1]}});
      },
      [](json& d) {
        while (d["parts"].size() <= kMaxCandidateParts) d["parts"].push_back(d["parts"][0]);
      },
      [](json& d) { d["parts"][1] = nullptr; },
      [](json& d) { d["parts"][1]["extra"] = 1; },
      [](json& d) { d["parts"][1].erase("pose"); },
      [](json& d) { d["parts"][1]["frame"] = "../up"; },
      [](json& d) { d["parts"][1]["pose"]["sigma_mm"] = 2001; },
      [](json& d) { d["parts"][1]["captured_at"] = "2026-05-01T12:00:00.249Z"; },
      [](json& d) { d["parts"][1]["share_ppm"] = 300'000; },
      [](json& d) { d["parts"][1]["share_ppm"] = -1; },
      [](json& d) { d["seam_mm"] = -1; },
      [](json& d) { d["seam_mm"] = 2001; },
  };
  for (std::size_t i = 0; i < edits.size(); ++i) {
    json edited = json::parse(candidate_json(pieced_sidecar()));
    edits[i](edited);
    EXPECT_THROW(parse_candidate(edited.dump(), "test"), Error) << "edit " << i;
  }
}

// Python writes the same document by itself: sorted, without blanks.
TEST(CandidateSidecar, IsCanonicalJson) {
  const std::string bytes = candidate_json(test::sample_sidecar(kKey));
  const test::TemporaryFolder folder;
  folder.write("sidecar.json", bytes);
  const auto python = test::run_process({"python3", "-c",
                                         "import json,sys; print(json.dumps(json.load(open(sys.argv[1])), "
                                         "sort_keys=True, separators=(',', ':')), end='')",
                                         folder / "sidecar.json"});
  ASSERT_EQ(python.code, 0) << python.err;
  EXPECT_EQ(python.out, bytes);
}

TEST(CandidateSidecar, AcceptsOneSpellingOnly) {
  const std::string bytes = candidate_json(test::sample_sidecar(kKey));
  const json document = json::parse(bytes);
  EXPECT_THROW(parse_candidate(document.dump(1), "test"), Error);
  EXPECT_THROW(parse_candidate(bytes + "\n", "test"), Error);
  EXPECT_THROW(parse_candidate(" " + bytes, "test"), Error);
  std::string other = bytes;
  other.replace(other.find("\"z\":19"), 6, "\"z\":1.9e1");
  EXPECT_THROW(parse_candidate(other, "test"), Error);
  other = bytes;
  other.replace(other.find("mini-07"), 7, "mini\\u002d07");
  EXPECT_THROW(parse_candidate(other, "test"), Error);
  other = bytes;
  other.replace(other.find("\"z\":19"), 6, "\"z\":19,\"z\":19");
  EXPECT_THROW(parse_candidate(other, "test"), Error);
}

TEST(CandidateSidecar, RejectsInvalidForms) {
  const std::vector<std::function<void(json&)>> edits{
      [](json& d) { d["extra"] = 1; },
      [](json& d) { d.erase("gsd_mm"); },
      [](json& d) { d["schema"] = "nadir.candidate/2"; },
      [](json& d) { d["airframe"] = ""; },
      [](json& d) { d["airframe"] = "../mini"; },
      [](json& d) { d["flight"] = std::string(65, 'a'); },
      [](json& d) { d["flight"] = "a.b"; },
      [](json& d) { d["base_package"] = std::string(64, 'A'); },
      [](json& d) { d["base_package"] = "ab"; },
      [](json& d) { d["frame"] = "../../etc/passwd"; },
      [](json& d) { d["frame"] = ".hidden"; },
      [](json& d) { d["frame"] = std::string(129, 'f'); },
      [](json& d) { d["z"] = 25; },
      [](json& d) { d["x"] = 1 << 19; },
      [](json& d) { d["y"] = -1; },
      [](json& d) { d["y"] = "1"; },
      [](json& d) { d["size"] = 0; },
      [](json& d) { d["size"] = (1 << 20) + 1; },
      [](json& d) { d["size"] = 18'446'744'073'709'551'615ULL; },
      [](json& d) { d["format"] = "png"; },
      [](json& d) { d["format"] = "jpg"; },
      [](json& d) { d["captured_at"] = "2026-05-01T12:00:00Z"; },
      [](json& d) { d["captured_at"] = 1'777'636'800; },
      [](json& d) { d["gsd_mm"] = 0; },
      [](json& d) { d["pose"] = nullptr; },
      [](json& d) { d["pose"]["extra"] = 1; },
      [](json& d) { d["pose"]["lat_e7"] = 900'000'001; },
      [](json& d) { d["pose"]["heading_mdeg"] = 360'000; },
      [](json& d) { d["pose"]["sigma_mm"] = 0; },
      [](json& d) { d["pose"]["cov_nn_mm2"] = -1; },
      [](json& d) { d["pose"]["cov_en_mm2"] = 4'000'010; },  // more than the variances allow
      [](json& d) { d["pose"]["refined"] = true; },
      [](json& d) { d["source"] = "gps"; },
      [](json& d) { d["anchor_age_ms"] = -1; },
      [](json& d) { d["trust"] = "trusted"; },
      [](json& d) { d["quality"]["clipped_ppm"] = 1'000'001; },
      [](json& d) {
        d["quality"] = json::array({1, 2, 3, 4, 5});
      },
      [](json& d) { d["camera"] = nullptr; },
  };
  for (std::size_t i = 0; i < edits.size(); ++i) {
    json edited = json::parse(candidate_json(test::sample_sidecar(kKey)));
    edits[i](edited);
    EXPECT_THROW(parse_candidate(edited.dump(), "test"), Error) << "edit " << i;
  }
  for (const std::string& text : {std::string(), std::string("null"), std::string("[]"), std::string(5000, '['),
                                  std::string("\xff\xfe"), std::string(5000, ' ')}) {
    EXPECT_THROW(parse_candidate(text, "test"), Error);
  }
}

TEST(CandidateSidecar, ThatAReaderWouldRejectIsNotWritten) {
  CandidateSidecar sidecar = test::sample_sidecar(kKey);
  sidecar.airframe = "mini 07";
  EXPECT_THROW(static_cast<void>(candidate_json(sidecar)), Error);
  sidecar = test::sample_sidecar(kKey);
  sidecar.frame = "\xff";
  EXPECT_THROW(static_cast<void>(candidate_json(sidecar)), Error);
  sidecar.frame = frame_label(sidecar.frame);
  EXPECT_EQ(parse_candidate(candidate_json(sidecar), "test").frame, "_");
}

TEST(CandidateSidecar, LabelsFrames) {
  EXPECT_EQ(frame_label("DJI 0001.JPG"), "DJI_0001.JPG");
  EXPECT_EQ(frame_label(""), "_");
  EXPECT_EQ(frame_label("../a"), "_.._a");
  EXPECT_EQ(frame_label(std::string(500, 'f')).size(), 128U);
}

class CandidateSignature : public ::testing::Test {
 protected:
  CandidateSignature() {
    root_.add_key(key_.public_key());
    root_.tile_signers["mini-07"].key_ids = {key_.public_key().id()};
  }
  SignatureCheck check(const Candidate& candidate) const {
    return check_candidate_signature(root_, candidate.sidecar, candidate.sidecar_bytes, candidate.signature,
                                     UtcTime{1'777'636'800});
  }
  PrivateKey key_ = PrivateKey::generate(), other_ = PrivateKey::generate();
  TrustRoot root_;
};

TEST_F(CandidateSignature, IsAcceptedFromTheAirframesKey) {
  EXPECT_TRUE(check(test::sample_candidate(key_, kKey)).findings.empty());
}

TEST_F(CandidateSignature, IsRejectedForAnotherAirframeKeyDocumentOrKind) {
  EXPECT_TRUE(check(test::sample_candidate(other_, kKey)).findings.contains("key.unknown"));
  Candidate forged = test::sample_candidate(key_, kKey);
  forged.sidecar.airframe = "mini-08";
  forged.sidecar_bytes = candidate_json(forged.sidecar);
  forged.signature = sign_candidate(key_, forged.sidecar_bytes);
  EXPECT_TRUE(check(forged).findings.has_errors());
  Candidate swapped = test::sample_candidate(key_, kKey);
  swapped.sidecar_bytes = candidate_json(test::sample_sidecar({19, 278'001, 182'000}));
  EXPECT_TRUE(check(swapped).findings.contains("signature.invalid"));
  Candidate confused = test::sample_candidate(key_, kKey);
  confused.signature = sign_payload(key_, kRootPayloadType, as_bytes(confused.sidecar_bytes));
  EXPECT_TRUE(check(confused).findings.contains("signature.invalid"));
  root_.revoked.insert(key_.public_key().id());
  EXPECT_TRUE(check(test::sample_candidate(key_, kKey)).findings.contains("key.revoked"));
}

}  // namespace
}  // namespace nadir
