// The attacks of attack_test.cpp as they come over the wire: what the real service answers, status and code.
#include <gmock/gmock.h>

#include <opencv2/imgproc.hpp>

#include "candidates/upload_server_fixture.hpp"

namespace nadir {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

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
  // Every tile is refused with this code, no byte of them is asked for.
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
  EXPECT_THAT(post(batch, "another-token-0123456789"), is("403", "forbidden")) << "who has seen it on its way";
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
  const test::FlightMaker stranger{{.airframe = "mini-07"}}, unknown{{.airframe = "mini-99"}};
  refused(stranger.batch(candidates(stranger, test::keys_in_a_row(2)), 1), "batch_signature");
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
  EXPECT_TRUE(IncomingPacks(options_.data / "incoming").uploads().empty()) << "no file came of it";
}

TEST_F(HttpAttack, OversizedPackIsRejectedBeforeTransfer) {
  const std::string upload = open(first_.batch(tiles(1)));
  const std::string pack = upload + "/packs/" + std::string(64, 'a');
  EXPECT_THAT(ask(request("PATCH", pack, patch_headers(0, kMaxPackSize + 1, "x"), "x")), is("413", "too-large"));
  // A body larger than any part: it is not awaited.
  const std::string type = "Content-Type: application/octet-stream\r\nContent-Length: 1000000000\r\n";
  EXPECT_THAT(ask(request("PATCH", pack, type)), StartsWith("HTTP/1.1 413 "));
}

TEST_F(HttpAttack, ZipBombsAreNotDecompressed) {
  // No encoding that unfolds is taken.
  const std::string upload = open(first_.batch(tiles(1)));
  EXPECT_THAT(patch(upload, test::pack_of(tiles(1)), "Content-Encoding: gzip\r\n"), StartsWith("HTTP/1.1 411 "));
  // A pack that says that gigabytes follow.
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
  const Candidate lying =
      first_.candidate(test::keys_in_a_row(1)[0], [](CandidateSidecar& sidecar) { sidecar.size += 1; });
  const std::string upload = open(first_.batch({lying}));
  const Bytes pack = test::pack_of({lying});
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
