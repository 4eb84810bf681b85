#include "trust/installed_report.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "base/error.hpp"

namespace nadir {
namespace {

using nlohmann::json;

InstalledReport sample_report() {
  return {.airframe = "mini-07",
          .number = 7,
          .reported_at = {1'795'000'060},
          .package = sha256(as_bytes("manifest")),
          .series = "valley",
          .sequence = 12,
          .root_version = 2,
          .verified_at = {1'795'000'000},
          .findings = {"airframe.unsigned"}};
}

class InstalledReportTest : public ::testing::Test {
 protected:
  TrustRoot root_with(const PrivateKey& key, const std::string& airframe) const {
    TrustRoot root;
    root.add_key(key.public_key());
    root.tile_signers[airframe] = Role{{key.public_key().id()}, 1};
    return root;
  }
  const PrivateKey key_ = PrivateKey::generate();
};

TEST_F(InstalledReportTest, SurvivesARoundTrip) {
  const SignedInstalledReport made = sign_installed_report(sample_report(), key_);
  const SignedInstalledReport read = parse_installed_report(made.json(), "report");
  EXPECT_EQ(read.json(), made.json());
  EXPECT_EQ(read.report.airframe, "mini-07");
  EXPECT_EQ(read.report.number, 7);
  EXPECT_EQ(read.report.package, sample_report().package);
  EXPECT_EQ(read.report.sequence, 12);
  EXPECT_EQ(read.report.verified_at, sample_report().verified_at);
  EXPECT_TRUE(read.report.accepted);
  EXPECT_EQ(read.report.findings, std::vector<std::string>{"airframe.unsigned"});
  EXPECT_FALSE(check_installed_signature(root_with(key_, "mini-07"), read, std::nullopt).findings.has_errors());
}

TEST_F(InstalledReportTest, RequiresTheAirframesOwnKey) {
  const SignedInstalledReport report = sign_installed_report(sample_report(), key_);
  const auto code = [&report](const TrustRoot& root) {
    return check_installed_signature(root, report, std::nullopt).findings.items().at(0).code;
  };
  EXPECT_EQ(code(root_with(key_, "mini-08")), "key.unknown") << "another airframe's key";
  EXPECT_EQ(code(root_with(PrivateKey::generate(), "mini-07")), "key.unknown");
  TrustRoot revoking = root_with(key_, "mini-07");
  revoking.revoked.insert(key_.public_key().id());
  EXPECT_EQ(code(revoking), "key.revoked");
}

// A signature with another payload type over the same bytes is not valid.
TEST_F(InstalledReportTest, RejectsASignatureOfAnotherPayloadType) {
  SignedInstalledReport report = sign_installed_report(sample_report(), key_);
  report.document.put(
      sign_payload(key_, "application/vnd.nadir.candidate-batch.v1+json", as_bytes(report.document.signed_bytes)));
  const auto check = check_installed_signature(root_with(key_, "mini-07"), report, std::nullopt);
  EXPECT_TRUE(check.findings.contains("signature.invalid"));
}

TEST_F(InstalledReportTest, RejectsInvalidDocuments) {
  const json good = json::parse(sign_installed_report(sample_report(), key_).json());
  const auto refused = [&good](const char* pointer, const json& value) {
    json bad = good;
    bad[json::json_pointer(pointer)] = value;
    EXPECT_THROW(parse_installed_report(bad.dump(), "report"), Error) << pointer << " " << value;
  };
  refused("/signed/schema", "nadir.installed/2");
  for (const char* name : {"", "../../etc/passwd", ".", "..", ".hidden", "a b", "a\n", "a/b"})
    refused("/signed/airframe", name);
  refused("/signed/airframe", std::string(65, 'a'));
  for (const std::int64_t number : {std::int64_t{0}, std::int64_t{-1}, std::int64_t{1} << 54}) {
    refused("/signed/number", number);
  }
  refused("/signed/number", 1.0);
  refused("/signed/reported_at", "2026-11-18");
  refused("/signed/verified_at", "2026-11-18T12:00:00+01:00");
  refused("/signed/package", "abc");
  refused("/signed/series", "");
  refused("/signed/root_version", 0);
  refused("/signed/result", "fine");
  refused("/signed/findings", json::array({""}));
  refused("/signed/findings", json::array({"\x1b[31m"}));
  refused("/signed/findings", std::vector<std::string>(kMaxInstalledFindings + 1, "a"));
  refused("/signed/more", 1);
  refused("/signatures", json::array());
  EXPECT_THROW(parse_installed_report(std::string(kMaxInstalledSize + 1, ' '), "report"), Error);
  EXPECT_NO_THROW(parse_installed_report(good.dump(), "report"));
}

TEST_F(InstalledReportTest, NumbersIncreaseWhateverTheClock) {
  const UtcTime now{1'795'000'000};
  EXPECT_EQ(next_report_number(std::nullopt, now), now.unix_s) << "an aircraft without a memory goes on above it";
  InstalledReport last = sample_report();
  last.number = now.unix_s + 1'000'000;  // from a clock that was ahead
  EXPECT_EQ(next_report_number(sign_installed_report(last, key_).json(), now), last.number + 1);
  EXPECT_EQ(next_report_number(sign_installed_report(sample_report(), key_).json(), now), now.unix_s);
  EXPECT_EQ(next_report_number("damaged", now), now.unix_s);
  EXPECT_EQ(next_report_number(std::nullopt, {-5}), 1);
}

}  // namespace
}  // namespace nadir
