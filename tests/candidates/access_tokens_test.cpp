// Tokens with scope and expiry: their file, what each may do over HTTP, and what the audit log records.
#include "nadir_candidates/access_tokens.hpp"

#include <gmock/gmock.h>

#include "base/error.hpp"
#include "candidates/upload_server_fixture.hpp"

namespace nadir {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

constexpr const char* kUpload = "upload-token-0123456789";
constexpr const char* kRead = "read-token-0123456789";
constexpr const char* kField = "field-token-0123456789";

class AccessTokens : public test::UploadServerTest {
 protected:
  void SetUp() override {
    UploadServerTest::SetUp();
    tokens_ = {token("station", kUpload, {TokenScope::upload}), token("dashboard", kRead, {TokenScope::read}),
               token("field", kField, {TokenScope::upload}, {"mini-07"})};
  }
  std::string announce_with(const char* secret, const test::FlightMaker& flight, int number) {
    const SignedBatch batch = flight.batch(candidates(flight, test::keys_in_a_row(1)), number);
    return ask(request("POST", "/v1/uploads",
                       "Content-Type: application/json\r\nIdempotency-Key: " + batch.batch.id + "\r\n", batch.json(),
                       secret));
  }
};

TEST_F(AccessTokens, SurviveARoundTrip) {
  const std::vector<AccessToken> read = parse_tokens(tokens_json(tokens_), "tokens");
  ASSERT_EQ(read.size(), 3U);
  EXPECT_EQ(read[2].id, "field");
  EXPECT_EQ(read[2].airframes, std::vector<std::string>{"mini-07"});
  EXPECT_EQ(read[1].scopes, std::set<TokenScope>{TokenScope::read});
  EXPECT_EQ(tokens_json(read), tokens_json(tokens_));
}

TEST_F(AccessTokens, OnlyDigestsAreStored) {
  const std::string text = tokens_json(tokens_);
  for (const char* secret : {kUpload, kRead, kField}) EXPECT_EQ(text.find(secret), std::string::npos);
}

TEST_F(AccessTokens, RejectsInvalidFiles) {
  const nlohmann::json good = nlohmann::json::parse(tokens_json(tokens_));
  const auto refused = [&](const char* pointer, const nlohmann::json& value) {
    nlohmann::json bad = good;
    bad[nlohmann::json::json_pointer(pointer)] = value;
    EXPECT_THROW(parse_tokens(bad.dump(), "tokens"), Error) << pointer << " " << value;
  };
  refused("/schema", "nadir.tokens/2");
  refused("/tokens/0/id", "");
  refused("/tokens/0/id", "a\nb");
  refused("/tokens/0/id", "dashboard");
  refused("/tokens/0/scope", nlohmann::json::array());
  refused("/tokens/0/scope/0", "admin");
  refused("/tokens/0/scope", {"read", "read"});
  refused("/tokens/0/airframes", nlohmann::json::array());
  refused("/tokens/0/expires", nullptr);
  refused("/tokens/0/expires", 4'000'000'000);
  refused("/tokens/0/sha256", good["tokens"][1]["sha256"]);
  refused("/tokens/0/sha256", "x");
  refused("/tokens/0/more", true);
  EXPECT_NO_THROW(parse_tokens(good.dump(), "tokens"));
}

TEST_F(AccessTokens, EnforcesScopes) {
  serve();
  EXPECT_THAT(announce_with(kUpload, first_, 1), StartsWith("HTTP/1.1 201 "));
  EXPECT_THAT(ask(request("GET", "/v1/installed", {}, {}, kRead)), StartsWith("HTTP/1.1 200 "));
  EXPECT_THAT(announce_with(kRead, first_, 2), HasSubstr("this call needs a token of scope upload"));
  EXPECT_THAT(ask(request("GET", "/v1/installed", {}, {}, kUpload)), StartsWith("HTTP/1.1 403 "));
  EXPECT_THAT(ask(request("GET", "/v1/uploads/0123456789abcdef0123456789abcdef", {}, {}, kRead)),
              StartsWith("HTTP/1.1 403 "));
  EXPECT_THAT(ask(request("GET", "/v1/reason-codes", {}, {}, kRead)), StartsWith("HTTP/1.1 200 "));
  EXPECT_EQ(audited("token of another scope").size(), 3U);
  EXPECT_EQ(audited("\"token\":\"dashboard\"").size(), 2U);
}

TEST_F(AccessTokens, ATokenOfOneAirframeCannotUploadForAnother) {
  serve();
  EXPECT_THAT(announce_with(kField, first_, 1), StartsWith("HTTP/1.1 201 "));
  EXPECT_THAT(announce_with(kField, second_, 2), StartsWith("HTTP/1.1 403 "));
  EXPECT_EQ(audited("this token is not for airframe mini-08").size(), 1U);
}

TEST_F(AccessTokens, AnExpiredTokenIsRejectedWithTheReason) {
  tokens_[0].expires = clock_.now();
  serve();
  const std::string answer = announce_with(kUpload, first_, 1);
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 401 "));
  EXPECT_THAT(answer, HasSubstr("token station expired"));
  EXPECT_EQ(service().counts().uploads, 0);
  EXPECT_EQ(audited("\"result\":\"token expired\",\"token\":\"station\"").size(), 1U);
}

// In the running service: a token that is removed from the file is rejected, a new one is accepted.
TEST_F(AccessTokens, ReloadsTheFile) {
  serve();
  EXPECT_FALSE(clients_->reload()) << "nothing has changed";
  tokens_[0] = token("station-2", "another-upload-token-01", {TokenScope::upload});
  tokens_[0].client = "station";
  write_file_atomic(tokens_file(), tokens_json(tokens_), 0600);
  EXPECT_TRUE(clients_->reload());
  EXPECT_THAT(announce_with(kUpload, first_, 1), StartsWith("HTTP/1.1 401 "));
  EXPECT_THAT(announce_with("another-upload-token-01", first_, 1), StartsWith("HTTP/1.1 201 "));
  write_file_atomic(tokens_file(), std::string("{"), 0600);
  EXPECT_FALSE(clients_->reload());
  EXPECT_THAT(clients_->fault(), HasSubstr("the tokens before it stay valid"));
  EXPECT_THAT(announce_with("another-upload-token-01", first_, 1), StartsWith("HTTP/1.1 200 "));
  std::filesystem::remove(tokens_file());
  EXPECT_FALSE(clients_->reload());
  EXPECT_NE(clients_->fault(), "");
}

// Two tokens of one client, one after the other: uploads that the first one began continue with the second.
TEST_F(AccessTokens, ASuccessorTokenContinuesTheUploads) {
  tokens_.push_back(token("station-next", "next-upload-token-01234", {TokenScope::upload}));
  tokens_.back().client = "station";
  serve();
  const std::string opened = announce_with(kUpload, first_, 1);
  const std::size_t at = opened.find("/v1/uploads/");
  ASSERT_NE(at, std::string::npos);
  const std::string path = opened.substr(at, opened.find("\r\n", at) - at);
  EXPECT_THAT(ask(request("GET", path, {}, {}, "next-upload-token-01234")), StartsWith("HTTP/1.1 200 "));
  EXPECT_THAT(ask(request("GET", path, {}, {}, kField)), StartsWith("HTTP/1.1 403 "));
}

TEST_F(AccessTokens, DuplicateTokensAreRejected) {
  const auto file = folder_.write("station", "one-more-token-0123456789\n");
  std::filesystem::permissions(file, std::filesystem::perms(0600));
  write_file_atomic(tokens_file(), tokens_json(tokens_), 0600);
  EXPECT_THROW(Clients({file.string()}, tokens_file()), UsageError) << "the same id";
  const auto same = folder_.write("other", std::string(kRead) + "\n");
  std::filesystem::permissions(same, std::filesystem::perms(0600));
  EXPECT_THROW(Clients({same.string()}, tokens_file()), UsageError) << "the same token";
}

// Guessed tokens neither fill the disk nor displace other lines of the log.
TEST_F(AccessTokens, GuessedTokensAreLimitedInTheAuditLog) {
  serve();
  for (int i = 0; i < 200; ++i) {
    ask(request("GET", "/v1/installed?\n{\"act\":\"forged\"}", {}, {}, "guess-0123456789"));
    ask(request("GET", "/v1/installed", {}, {}, "guess-0123456789"));
  }
  EXPECT_EQ(audited("no known token").size(), AuditLimits{}.equal_per_minute);
  for (const std::string& line : audited("")) EXPECT_TRUE(nlohmann::json::parse(line).contains("n")) << line;
}

}  // namespace
}  // namespace nadir
