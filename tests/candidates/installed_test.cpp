// Aircraft's reports of installed packages: over HTTP, signed, and never older than the last one.
#include <gmock/gmock.h>

#include "base/error.hpp"
#include "candidates/upload_server_fixture.hpp"

namespace nadir {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

class Installed : public test::UploadServerTest {
 protected:
  SignedInstalledReport report(std::int64_t number, std::int64_t sequence = 3,
                               const test::FlightMaker* signer = nullptr, const std::string& airframe = "mini-07") {
    return sign_installed_report({.airframe = airframe,
                                  .number = number,
                                  .reported_at = clock_.now(),
                                  .package = sha256(as_bytes("manifest")),
                                  .series = "valley",
                                  .sequence = sequence,
                                  .root_version = 1,
                                  .verified_at = clock_.now()},
                                 (signer != nullptr ? *signer : first_).key());
  }
  std::string bring(const std::string& body, const char* token = test::kToken) {
    return ask(request("POST", "/v1/installed", "Content-Type: application/json\r\n", body, token));
  }
  nlohmann::json listed() {
    const std::string answer = ask(request("GET", "/v1/installed"));
    return nlohmann::json::parse(answer.substr(answer.find("\r\n\r\n") + 4))["aircraft"];
  }
  std::filesystem::path file() const { return options_.data / "installed" / "mini-07.json"; }
};

TEST_F(Installed, AReportIsStoredOnceAndListed) {
  serve();
  const std::string text = report(5).json();
  EXPECT_THAT(bring(text), StartsWith("HTTP/1.1 201 "));
  EXPECT_THAT(bring(text), StartsWith("HTTP/1.1 200 ")) << "the reply may have been lost";
  const nlohmann::json list = listed();
  ASSERT_EQ(list.size(), 1U);
  EXPECT_EQ(list[0]["airframe"], "mini-07");
  EXPECT_EQ(list[0]["number"], 5);
  EXPECT_EQ(list[0]["package"], sha256(as_bytes("manifest")).hex());
  EXPECT_EQ(list[0]["key"], first_.key().public_key().id());
  EXPECT_EQ(audited("installed.report").size(), 1U);
}

TEST_F(Installed, AnOlderReportIsRejectedAlsoAfterARestart) {
  serve();
  bring(report(5).json());
  for (int round = 0; round < 2; ++round) {
    EXPECT_THAT(bring(report(4).json()), StartsWith("HTTP/1.1 409 "));
    EXPECT_THAT(bring(report(5, 4).json()), HasSubstr("report-older")) << "the same number, something else";
    EXPECT_EQ(listed()[0]["number"], 5);
    server_.reset();
    queue_.reset();
    restarted();
    serve();
  }
  EXPECT_THAT(bring(report(6).json()), StartsWith("HTTP/1.1 201 "));
}

TEST_F(Installed, OtherKeysAndTokensAreRejected) {
  serve();
  EXPECT_THAT(bring(report(5, 3, &second_).json()), StartsWith("HTTP/1.1 422 ")) << "mini-08's key for mini-07";
  EXPECT_THAT(bring(report(5).json(), "another-token-0123456789"), StartsWith("HTTP/1.1 403 ")) << "mini-08's token";
  EXPECT_THAT(bring(report(5, 3, nullptr, "untrusted").json()), StartsWith("HTTP/1.1 422 "));
  EXPECT_THAT(bring(report(5).json(), nullptr), StartsWith("HTTP/1.1 401 "));
  std::string changed = report(5).json();
  changed.replace(changed.find("valley"), 6, "valleY");
  EXPECT_THAT(bring(changed), HasSubstr("signature.invalid"));
  EXPECT_TRUE(listed().empty());
  EXPECT_EQ(audited("\"act\":\"installed.report\",\"result\":\"refused\"").size(), 4U);
}

TEST_F(Installed, RejectsInvalidDocuments) {
  serve();
  EXPECT_THAT(bring("{"), StartsWith("HTTP/1.1 400 "));
  for (const char* body : {"{}", "[]", R"({"signed":{},"signatures":[]})"}) {
    EXPECT_THAT(bring(body), HasSubstr("urn:nadir:problem:report-invalid")) << body;
  }
  EXPECT_THAT(bring(std::string(kMaxInstalledSize + 1, ' ')), StartsWith("HTTP/1.1 413 "));
  EXPECT_THAT(ask(request("DELETE", "/v1/installed")), StartsWith("HTTP/1.1 405 "));
}

// An aircraft with an older package than it reported before: it may be permitted, and the operator must see it.
TEST_F(Installed, AnOlderPackageIsStoredAndListedAsSuch) {
  serve();
  bring(report(5, 8).json());
  EXPECT_THAT(bring(report(6, 7).json()), StartsWith("HTTP/1.1 201 "));
  EXPECT_EQ(listed()[0]["sequence"], 7);
  EXPECT_EQ(listed()[0]["highest_sequence"], 8);
}

// A stolen key was used up to the highest number. Once it is revoked, the numbers of the aircraft's new key start
// again.
TEST_F(Installed, ARevokedKeysNumbersDoNotBlockTheNextKey) {
  serve();
  const std::int64_t last = std::int64_t{1} << 53;
  EXPECT_THAT(bring(report(last).json()), StartsWith("HTTP/1.1 201 "));
  EXPECT_THAT(bring(report(6).json()), StartsWith("HTTP/1.1 409 "));
  const test::FlightMaker renewed({.airframe = "mini-07"});
  write_file_atomic(options_.trust,
                    test::root_text({&first_, &renewed, &second_}, signer_, 2, {first_.key().public_key().id()}));
  EXPECT_THAT(bring(report(7).json()), HasSubstr("key.revoked"));
  EXPECT_THAT(bring(report(7, 3, &renewed).json()), StartsWith("HTTP/1.1 201 "));
  EXPECT_EQ(listed()[0]["number"], 7);
}

TEST_F(Installed, ADamagedRecordIsListedAndReplaced) {
  serve();
  bring(report(5).json());
  const std::string whole = read_text_file(file());
  for (const std::string& damaged : {std::string(), whole.substr(0, whole.size() / 2), std::string("{}")}) {
    write_file_atomic(file(), damaged);
    EXPECT_NE(listed()[0]["damaged"], "") << damaged;
  }
  std::filesystem::copy_file(file(), options_.data / "installed" / "mini-08.json");
  write_file_atomic(options_.data / "installed" / "mini-08.json", whole);
  EXPECT_EQ(listed()[1]["damaged"], "a report of another airframe");
  EXPECT_THAT(bring(report(5).json()), StartsWith("HTTP/1.1 201 "));
  EXPECT_EQ(listed()[0]["damaged"], "");
}

TEST_F(Installed, AForgottenAirframeStartsAgain) {
  serve();
  bring(report(5).json());
  InstalledStore store(options_.data / "installed");
  EXPECT_FALSE(store.forget("../catalogue"));
  EXPECT_TRUE(store.forget("mini-07"));
  EXPECT_FALSE(store.forget("mini-07"));
  EXPECT_THAT(bring(report(2).json()), StartsWith("HTTP/1.1 201 "));
}

}  // namespace
}  // namespace nadir
