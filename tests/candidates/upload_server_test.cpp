// The service behind HTTP: what its callers see, and what hostile ones cannot do.
#include "nadir_candidates/upload_server.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>

#include "base/bytes.hpp"
#include "base/error.hpp"
#include "candidates/upload_server_fixture.hpp"

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
  EXPECT_EQ(silent.front().read_to_the_end(), "") << "the first one was closed";
}

// A client that sends requests and reads no responses is closed as well, and keeps its share until then.
TEST_F(UploadServerTest, UnreadResponsesDoNotBlockOthers) {
  serve({.connections = 4, .answer_time = std::chrono::hours(1)});
  std::string many;
  for (int i = 0; i < 3000; ++i) many += request("GET", "/v1/reason-codes");
  std::vector<RawClient> deaf;
  for (int i = 0; i < 4; ++i) {
    deaf.emplace_back(server_->port(), 4096);
    deaf.back().send(many);
  }
  // They work for a while before their responses fill the buffers.
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
  const auto client = clients.find("Bearer 0123456789abcdef");
  ASSERT_NE(client, nullptr);
  EXPECT_TRUE(client->client.may("mini-07"));
  EXPECT_FALSE(client->client.may("mini-09"));
  EXPECT_EQ(clients.find("Bearer x"), nullptr);
}

// The attacks of attack_test.cpp over HTTP: status and code of the real service's responses.

using nlohmann::json;
using ::testing::AllOf;

class HttpAttack : public test::UploadServerTest {
 protected:
  void SetUp() override {
    test::UploadServerTest::SetUp();
    serve();
  }
  std::string post(const SignedBatch& batch, const char* token = test::kToken) {
    const std::string headers = "Idempotency-Key: " + batch.batch.id + "\r\nContent-Type: application/json\r\n";
    return ask(request("POST", "/v1/uploads", headers, batch.json(), token));
  }
  static json body_of(const std::string& answer) { return json::parse(answer.substr(answer.find("\r\n\r\n") + 4)); }
  // "/v1/uploads/ID" of a batch that is taken.
  std::string open(const SignedBatch& batch) {
    return "/v1/uploads/" + body_of(post(batch))["upload_id"].get<std::string>();
  }
  // Every tile is refused with this code, and none of their bytes is requested.
  void refused(const SignedBatch& batch, const char* code) {
    const std::string answer = post(batch);
    ASSERT_THAT(answer, StartsWith("HTTP/1.1 201 "));
    const json body = body_of(answer);
    EXPECT_TRUE(body["missing"].empty());
    EXPECT_EQ(body["refused"].size(), batch.batch.tiles.size());
    for (const json& tile : body["refused"]) EXPECT_EQ(tile["code"], code);
  }
  std::string patch(const std::string& upload, ByteView pack, const std::string& headers = {}) {
    const std::string text(as_text(pack));
    return ask(
        request("PATCH", upload + "/packs/" + sha256(pack).hex(), headers + patch_headers(0, pack.size(), text), text));
  }
  static auto is(const char* status, const char* problem) {
    return AllOf(StartsWith(std::string("HTTP/1.1 ") + status), HasSubstr("application/problem+json"),
                 HasSubstr(std::string("urn:nadir:problem:") + problem + "\""));
  }
  std::vector<Candidate> tiles(std::uint32_t count) { return candidates(first_, test::keys_in_a_row(count)); }
};

TEST_F(HttpAttack, ReplayedBatchIsTheSameUpload) {
  const SignedBatch batch = first_.batch(tiles(2));
  const std::string first = post(batch), again = post(batch);
  EXPECT_THAT(first, StartsWith("HTTP/1.1 201 "));
  EXPECT_THAT(again, StartsWith("HTTP/1.1 200 "));
  EXPECT_EQ(body_of(first)["upload_id"], body_of(again)["upload_id"]);
  EXPECT_THAT(post(batch, "another-token-0123456789"), is("403", "forbidden"))
      << "another client, which intercepted it";
  const std::string other = first_.batch(tiles(1), 2).json();
  const std::string headers = "Idempotency-Key: " + batch.batch.id + "\r\nContent-Type: application/json\r\n";
  EXPECT_THAT(ask(request("POST", "/v1/uploads", headers, other)), is("422", "key-reused"));
}

TEST_F(HttpAttack, SwappedTileIsRejectedWithItsPack) {
  auto swapped = tiles(2);
  const std::string upload = open(first_.batch(swapped));
  swapped[0].tile = first_.candidate(test::keys_in_a_row(3)[2]).tile;
  const Bytes pack = test::pack_of(swapped);
  EXPECT_THAT(patch(upload, pack), is("422", "pack-invalid"));
  EXPECT_THAT(ask(request("HEAD", upload + "/packs/" + sha256(pack).hex())), StartsWith("HTTP/1.1 404 "));
}

TEST_F(HttpAttack, ForgedAirframeIsRejected) {
  const test::FlightMaker untrusted{{.airframe = "mini-07"}}, unknown{{.airframe = "mini-99"}};
  refused(untrusted.batch(candidates(untrusted, test::keys_in_a_row(2)), 1), "batch_signature");
  refused(unknown.batch(candidates(unknown, test::keys_in_a_row(2)), 2), "batch_signature");
}

TEST_F(HttpAttack, RevokedKeyIsRejected) {
  write_root(2, {first_.key().public_key().id()});
  refused(first_.batch(tiles(2)), "airframe_revoked");
}

TEST_F(HttpAttack, PathTricksInNamesAreNotFound) {
  const std::string upload = open(first_.batch(tiles(1)));
  for (const char* path :
       {"/v1/uploads/..", "/v1/uploads/../../etc/passwd", "/v1/uploads/%2e%2e%2f%2e%2e%2fetc%2fpasswd",
        "/v1/uploads//etc/passwd", "/v1/uploads/%00", "/../../etc/passwd", "/v1/uploads/....//....//etc/passwd",
        "/v1/uploads/..%5c..%5cwindows"}) {
    EXPECT_THAT(ask(request("GET", path)), AllOf(StartsWith("HTTP/1.1 40"), Not(HasSubstr("root:")))) << path;
  }
  for (const char* pack : {"..", "../../../root.json", "%2e%2e%2froot.json", "/etc/passwd", "ABC"}) {
    const std::string answer = ask(request("PATCH", upload + "/packs/" + pack, patch_headers(0, 1, "x"), "x"));
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 40")) << pack;
  }
  EXPECT_TRUE(IncomingPacks(options_.data / "incoming").uploads().empty()) << "no file was made";
}

TEST_F(HttpAttack, OversizedPackIsRejectedBeforeTransfer) {
  const std::string upload = open(first_.batch(tiles(1)));
  const std::string pack = upload + "/packs/" + std::string(64, 'a');
  EXPECT_THAT(ask(request("PATCH", pack, patch_headers(0, kMaxPackSize + 1, "x"), "x")), is("413", "too-large"));
  // A body larger than any part: the service does not wait for it.
  const std::string type = "Content-Type: application/octet-stream\r\nContent-Length: 1000000000\r\n";
  EXPECT_THAT(ask(request("PATCH", pack, type)), StartsWith("HTTP/1.1 413 "));
}

TEST_F(HttpAttack, ZipBombsAreNotDecompressed) {
  // No compressed encoding is accepted.
  const std::string upload = open(first_.batch(tiles(1)));
  EXPECT_THAT(patch(upload, test::pack_of(tiles(1)), "Content-Encoding: gzip\r\n"), StartsWith("HTTP/1.1 411 "));
  // A pack that announces gigabytes.
  Bytes bomb = test::pack_of(tiles(1));
  std::fill_n(bomb.begin() + 8, 4, std::uint8_t{0xff});
  EXPECT_THAT(patch(upload, bomb), is("422", "pack-invalid"));
  // An image of few bytes and 16 million pixels.
  const Bytes unfolds = encode_image(cv::Mat(4000, 4000, CV_8UC3, cv::Scalar(7, 7, 7)), ImageFormat::jpeg, 10);
  const Candidate large = first_.encoded_candidate(test::keys_in_a_row(2)[1], unfolds);
  const std::string other = open(first_.batch({large}, 2));
  EXPECT_THAT(patch(other, test::pack_of({large})), StartsWith("HTTP/1.1 204 "));
  EXPECT_THAT(ask(request("POST", other + "/complete")), StartsWith("HTTP/1.1 202 "));
  judge_all();
  const json tile = body_of(ask(request("GET", other)))["tiles"][0];
  EXPECT_EQ(tile["verdict"], "rejected");
  EXPECT_EQ(tile["code"], "format_unsupported");
}

TEST_F(HttpAttack, FalseSizesAreRejected) {
  const Candidate false_size =
      first_.candidate(test::keys_in_a_row(1)[0], [](CandidateSidecar& sidecar) { sidecar.size += 1; });
  const std::string upload = open(first_.batch({false_size}));
  const Bytes pack = test::pack_of({false_size});
  EXPECT_THAT(patch(upload, pack), is("422", "pack-invalid"));
  const std::string text(as_text(pack)), path = upload + "/packs/" + sha256(pack).hex();
  EXPECT_THAT(ask(request("PATCH", path, patch_headers(0, 1'000, text), text)), is("413", "too-large"));
  EXPECT_THAT(ask(request("PATCH", path, patch_headers(1'000, pack.size(), text), text)), is("409", "offset-mismatch"));
}

TEST_F(HttpAttack, ManipulatedTimesAreRejected) {
  first_.options().captured_at = {clock_.now().unix_s + test::kDay_s};
  refused(first_.batch(tiles(1), 1), "captured_in_future");
  first_.options().captured_at = {clock_.now().unix_s - 91 * test::kDay_s};
  refused(first_.batch(tiles(1), 2), "too_old");
  first_.options().captured_at = {clock_.now().unix_s - 60};
  // The batch itself from tomorrow, so that its tiles look old enough.
  Batch ahead = first_.batch(tiles(1), 3).batch;
  ahead.created_at = {clock_.now().unix_s + test::kDay_s};
  refused(sign_batch(ahead, first_.key()), "captured_in_future");
}

}  // namespace
}  // namespace nadir
