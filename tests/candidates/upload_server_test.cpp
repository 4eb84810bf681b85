// The service behind HTTP: what its callers see, and what hostile ones cannot do.
#include "nadir_candidates/upload_server.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "candidates/upload_server_fixture.hpp"
#include "base/bytes.hpp"

namespace nadir {
namespace {

using test::RawClient;
using ::testing::HasSubstr;
using ::testing::StartsWith;

using test::kToken;
using test::UploadServerTest;

TEST_F(UploadServerTest, UploadsABatchOverHttp) {
  serve();
  const auto tiles = candidates(first_, test::keys_in_a_row(2));
  const SignedBatch batch = first_.batch(tiles);
  const std::string key = "Idempotency-Key: " + batch.batch.id + "\r\nContent-Type: application/json\r\n";
  const std::string opened = ask(request("POST", "/v1/uploads", key, batch.json()));
  ASSERT_THAT(opened, StartsWith("HTTP/1.1 201 "));
  const auto announcement = nlohmann::json::parse(opened.substr(opened.find("\r\n\r\n") + 4));
  EXPECT_EQ(announcement["missing"].size(), 2U);
  EXPECT_THAT(ask(request("POST", "/v1/uploads", key, batch.json())), StartsWith("HTTP/1.1 200 "));

  const std::string upload = "/v1/uploads/" + announcement["upload_id"].get<std::string>();
  const Bytes bytes = test::pack_of(tiles);
  const std::string text(as_text(bytes)), pack = upload + "/packs/" + sha256(bytes).hex();
  EXPECT_THAT(ask(request("HEAD", pack)), StartsWith("HTTP/1.1 404 "));
  const std::string half = text.substr(0, 3000);
  const std::string first = ask(request("PATCH", pack, patch_headers(0, text.size(), half), half));
  EXPECT_THAT(first, StartsWith("HTTP/1.1 204 "));
  EXPECT_THAT(first, HasSubstr("Upload-Offset: 3000\r\n"));
  EXPECT_THAT(ask(request("HEAD", pack)), HasSubstr("Upload-Offset: 3000\r\n"));
  EXPECT_THAT(ask(request("PATCH", pack, patch_headers(0, text.size(), half), half)), StartsWith("HTTP/1.1 409 "));
  EXPECT_THAT(ask(request("POST", upload + "/complete")), StartsWith("HTTP/1.1 409 "));
  const std::string rest = text.substr(3000);
  EXPECT_THAT(ask(request("PATCH", pack, patch_headers(3000, text.size(), rest), half + rest.substr(half.size()))),
              StartsWith("HTTP/1.1 460 "));
  EXPECT_THAT(ask(request("PATCH", pack, patch_headers(3000, text.size(), rest), rest)), StartsWith("HTTP/1.1 204 "));
  EXPECT_THAT(ask(request("POST", upload + "/complete")), StartsWith("HTTP/1.1 202 "));
  judge_all();
  const std::string status = ask(request("GET", upload));
  EXPECT_THAT(status, HasSubstr("\"accepted\""));
  EXPECT_THAT(status, HasSubstr("\"judged\""));
}

TEST_F(UploadServerTest, WithoutATokenOnlyHealthIsServed) {
  serve();
  EXPECT_THAT(ask(request("GET", "/v1/health", {}, {}, nullptr)), HasSubstr("\"pass\""));
  for (const char* path : {"/v1/reason-codes", "/v1/uploads/x", "/nothing", "/"}) {
    const std::string answer = ask(request("GET", path, {}, {}, nullptr));
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 401 ")) << path;
    EXPECT_THAT(answer, HasSubstr("WWW-Authenticate: Bearer"));
    EXPECT_THAT(ask(request("GET", path, {}, {}, "0123456789abcdef0124")), StartsWith("HTTP/1.1 401 "));
  }
  EXPECT_THAT(ask(request("GET", "/v1/reason-codes")), HasSubstr("better_tile_exists"));
}

TEST_F(UploadServerTest, RejectsRequestsOutsideTheContract) {
  serve();
  const auto is = [this](const std::string& text, const char* status) {
    const std::string answer = ask(text);
    EXPECT_THAT(answer, StartsWith(std::string("HTTP/1.1 ") + status)) << text.substr(0, 200);
    EXPECT_THAT(answer, HasSubstr("application/problem+json"));
  };
  is(request("GET", "/v1/nothing"), "404");
  is(request("DELETE", "/v1/uploads"), "405");
  is(request("GET", "/v1/uploads"), "405");
  is(request("POST", "/v1/uploads", "Content-Type: application/json\r\n", "{}"), "400");
  is(request("POST", "/v1/uploads", "Content-Type: text/plain\r\n", "{}"), "415");
  is(request("POST", "/v1/uploads"), "411");
  is(request("POST", "/v1/uploads", "Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n"), "411");
  is(request("POST", "/v1/uploads", "Content-Type: application/json\r\nTransfer-Encoding: gzip\r\n", "{}"), "411");
  is(request("GET", "/v1/reason-codes", "Transfer-Encoding: gzip\r\n"), "413");
  is(request("POST", "/v1/uploads", "Content-Type: application/json\r\nContent-Length: 99999999\r\n"), "413");
  is("GET /v1/reason-codes HTTP/1.1\r\nHost: evil.example\r\n\r\n", "421");
  is("nonsense\r\n\r\n", "400");
  is(request("GET", "/v1/reason-codes", "X: " + std::string(10'000, 'x') + "\r\n"), "431");
  const std::string pack = "/v1/uploads/0123456789abcdef0123456789abcdef/packs/" + std::string(64, 'a');
  const std::string type = "Content-Type: application/octet-stream\r\n";
  is(request("PATCH", pack, type, "x"), "400");
  is(request("PATCH", pack, type + "Upload-Offset: -1\r\n", "x"), "400");
  is(request("PATCH", pack, type + "Upload-Offset: 0\r\nContent-Digest: md5=:AAAA:\r\n", "x"), "400");
  is(request("PATCH", pack, patch_headers(0, 100, "x"), "x"), "404");
  is(request("PATCH", pack, type + "Content-Encoding: gzip\r\n", "x"), "411");
  is(request("PATCH", "/v1/uploads/x/packs/..%2f..%2fetc", type, "x"), "404");
}

TEST_F(UploadServerTest, AnswersExpect100Continue) {
  serve();
  RawClient client = connect();
  const auto tiles = candidates(first_, test::keys_in_a_row(1));
  const SignedBatch batch = first_.batch(tiles);
  const std::string text =
      request("POST", "/v1/uploads",
              "Content-Type: application/json\r\nExpect: 100-continue\r\nIdempotency-Key: " + batch.batch.id + "\r\n",
              batch.json());
  const std::size_t body = text.find("\r\n\r\n") + 4;
  client.send(text.substr(0, body));
  EXPECT_THAT(client.read_until("\r\n\r\n"), StartsWith("HTTP/1.1 100 "));
  client.send(text.substr(body));
  EXPECT_THAT(client.read_until("expires_at"), StartsWith("HTTP/1.1 201 "));
}

TEST_F(UploadServerTest, ClosesASlowLorisConnection) {
  serve({.header_time = std::chrono::milliseconds(300), .body_time = std::chrono::milliseconds(300)});
  RawClient in_header = connect(), in_body = connect();
  in_header.send("GET /v1/health HTTP/1.1\r\nHost: local");
  in_body.send(request("POST", "/v1/uploads", "Content-Type: application/json\r\nContent-Length: 1000\r\n") +
               "{\"signed\"");
  EXPECT_EQ(in_header.read_to_the_end(), "");
  EXPECT_EQ(in_body.read_to_the_end(), "");
  EXPECT_THAT(ask(request("GET", "/v1/health")), StartsWith("HTTP/1.1 200 "));
}

TEST_F(UploadServerTest, ManyIdleConnectionsDoNotBlockOthers) {
  serve({.connections = 8});
  std::vector<RawClient> silent;
  for (int i = 0; i < 40; ++i) {
    silent.push_back(connect());
    silent.back().send("GET /v1/health HTTP/1.1\r\n");
  }
  EXPECT_THAT(ask(request("GET", "/v1/reason-codes")), StartsWith("HTTP/1.1 200 "));
  EXPECT_EQ(silent.front().read_to_the_end(), "") << "the first one made room";
}

// Who asks and asks and takes no answer makes room as well, and holds his share for as long.
TEST_F(UploadServerTest, UnreadResponsesDoNotBlockOthers) {
  serve({.connections = 4, .answer_time = std::chrono::hours(1)});
  std::string many;
  for (int i = 0; i < 3000; ++i) many += request("GET", "/v1/reason-codes");
  std::vector<RawClient> deaf;
  for (int i = 0; i < 4; ++i) {
    deaf.emplace_back(server_->port(), 4096);
    deaf.back().send(many);
  }
  // They are at work for a while before their answers pile up.
  std::string answer;
  for (int i = 0; i < 50'000 && answer.empty(); ++i) {
    answer = ask(request("GET", "/v1/reason-codes", {}, {}, "another-token-0123456789"));
  }
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200 "));
}

TEST_F(UploadServerTest, OneClientsOpenBodiesLeaveRoomForOthers) {
  serve({.shares = {.client_requests = 4}});
  std::vector<RawClient> greedy;
  const std::string open = request("POST", "/v1/uploads", "Content-Type: application/json\r\nContent-Length: 1000\r\n");
  for (int i = 0; i < 4; ++i) {
    greedy.push_back(connect());
    greedy.back().send("GET /v1/reason-codes HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer " +
                       std::string(kToken) + "\r\n\r\n");
    greedy.back().read_until("policy\"");
    greedy.back().send(open + "{");
  }
  // The four are being read once a fifth is refused.
  std::string fifth;
  for (int i = 0; i < 1000 && fifth.find("HTTP/1.1 429 ") != 0; ++i) fifth = ask(request("GET", "/v1/reason-codes"));
  EXPECT_THAT(fifth, HasSubstr("Retry-After: "));
  EXPECT_THAT(ask(request("GET", "/v1/reason-codes", {}, {}, "another-token-0123456789")), StartsWith("HTTP/1.1 200 "));
}

TEST_F(UploadServerTest, LimitsTheTotalBodySizeOfAClient) {
  serve({.shares = {.client_bodies_bytes = 1000}});
  const std::string head = "Content-Type: application/json\r\nContent-Length: 1001\r\n";
  EXPECT_THAT(ask(request("POST", "/v1/uploads", head)), StartsWith("HTTP/1.1 429 "));
}

TEST_F(UploadServerTest, StopsDuringRequests) {
  serve();
  RawClient waiting = connect(), sending = connect();
  sending.send(request("POST", "/v1/uploads", "Content-Type: application/json\r\nContent-Length: 1000\r\n") + "{");
  server_.reset();
  EXPECT_EQ(waiting.read_to_the_end(), "");
  EXPECT_EQ(sending.read_to_the_end(), "");
}

TEST_F(UploadServerTest, TokensIdentifyClients) {
  const auto one = folder_.write("a.token", "0123456789abcdef\n"),
             same = folder_.write("b.token", "0123456789abcdef\n");
  std::filesystem::create_directories(folder_ / "x");
  const auto twin = folder_.write("x/a.token", "fedcba9876543210\n");
  for (const auto& path : {one, same, twin}) std::filesystem::permissions(path, std::filesystem::perms(0600));
  EXPECT_THROW(Clients({one.string(), same.string()}), UsageError);
  EXPECT_THROW(Clients({one.string(), twin.string()}), UsageError);
  const Clients clients({"mini-07=" + one.string(), "mini-08=" + one.string()});
  const UploadClient* client = clients.find("Bearer 0123456789abcdef");
  ASSERT_NE(client, nullptr);
  EXPECT_TRUE(client->may("mini-07"));
  EXPECT_FALSE(client->may("mini-09"));
  EXPECT_EQ(clients.find("Bearer x"), nullptr);
}

}  // namespace
}  // namespace nadir
