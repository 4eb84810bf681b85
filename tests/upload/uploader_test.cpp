#include "upload/uploader.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "upload/outbox_fixture.hpp"
#include "upload/outbox_upkeep.hpp"

namespace nadir {
namespace {

TEST(BackOff, IsRandomUpToADoublingLimit) {
  Random random(1);
  for (int failures = 0; failures < 30; ++failures) {
    const std::int64_t limit_ms = std::min<std::int64_t>(900'000, std::int64_t{2'000} << std::min(failures, 20));
    std::int64_t least = limit_ms, most = 0;
    for (int draw = 0; draw < 500; ++draw) {
      const std::int64_t wait_ms = back_off_ms(failures, std::nullopt, random);
      least = std::min(least, wait_ms);
      most = std::max(most, wait_ms);
    }
    EXPECT_GE(least, 0);
    EXPECT_LT(most, limit_ms);
    EXPECT_LT(least, limit_ms / 10) << failures;
    EXPECT_GT(most, limit_ms - limit_ms / 10) << failures;
  }
}

TEST(BackOff, TheDelayRequestedByTheServiceHasPrecedence) {
  Random random(1);
  EXPECT_EQ(back_off_ms(9, 7, random), 7'000);
  EXPECT_EQ(back_off_ms(0, 0, random), 0);
  EXPECT_EQ(back_off_ms(0, 1'000'000, random), 86'400'000) << "a day at most";
  EXPECT_EQ(back_off_ms(0, -5, random), 0);
}

TEST(BackOff, IsTheSameForTheSameSeed) {
  Random one(42), other(42);
  for (int i = 0; i < 20; ++i) EXPECT_EQ(back_off_ms(i, std::nullopt, one), back_off_ms(i, std::nullopt, other));
}

// The uploader's decisions, with a service of a few lines and a clock that does not tick by itself. The faults of real
// lines and real kills are in faults_test.py.

using nlohmann::json;

class StoppedClock final : public UploadClock {
 public:
  std::int64_t now_ms() const override { return now_ms_; }
  void wait(std::int64_t duration_ms, const std::function<void()>&) override {
    waits_ms.push_back(duration_ms);
    now_ms_ += duration_ms;
  }
  std::vector<std::int64_t> waits_ms;

 private:
  std::int64_t now_ms_ = 1'795'000'000'000;
};

// Takes everything; before that, says what was put into `first`.
class SmallService final : public HttpTransport {
 public:
  std::deque<HttpResult> first;
  std::vector<std::string> calls;
  std::map<std::string, std::size_t> offsets;
  json announced;

  HttpResult exchange(const HttpRequest& request) override {
    calls.push_back(request.method + " " + std::string(request.path.substr(request.path.rfind('/') + 1, 8)));
    if (!first.empty()) {
      HttpResult result = std::move(first.front());
      first.pop_front();
      return result;
    }
    if (request.method == "POST" && request.path == "/v1/uploads") return announce(as_text(request.body));
    if (request.method == "POST") return HttpReply{202, {}, "{}"};
    if (request.method == "GET") return status();
    std::size_t& offset = offsets[request.path];
    if (request.method == "PATCH") offset += request.body.size();
    return HttpReply{request.method == "HEAD" ? 200 : 204, {{"upload-offset", std::to_string(offset)}}, ""};
  }

 private:
  HttpResult announce(std::string_view body) {
    announced = json::parse(body)["signed"];
    json missing = json::array();
    for (const json& tile : announced["tiles"]) missing.push_back(tile["sidecar"]["sha256"]);
    return HttpReply{201,
                     {},
                     json{{"upload_id", "upload-01"},
                          {"missing", missing},
                          {"known", json::array()},
                          {"refused", json::array()},
                          {"part_max", 4096},
                          {"expires_at", "2030-01-01T00:00:00Z"}}
                         .dump()};
  }
  HttpResult status() const {
    json tiles = json::array();
    for (const json& tile : announced["tiles"]) {
      tiles.push_back({{"sha256", tile["sidecar"]["sha256"]},
                       {"verdict", "accepted"},
                       {"code", nullptr},
                       {"detail", ""},
                       {"retryable", false}});
    }
    return HttpReply{
        200,
        {},
        json{{"upload_id", "upload-01"}, {"batch", announced["batch"]}, {"state", "judged"}, {"tiles", tiles}}.dump()};
  }
};

class Upload : public test::OutboxFixture {
 protected:
  UploadOutcome run(UploadOptions options = {}) {
    ServiceClient client(service_);
    Uploader uploader(*outbox_, client,
                      {clock_, Random(1), progress_, [this](const std::string& line) { log_.push_back(line); }},
                      options);
    return uploader.run();
  }
  static HttpReply problem(int status, std::map<std::string, std::string> headers = {}) {
    return {status, std::move(headers), R"({"type":"x","title":"TransferError","status":0,"detail":"as wanted"})"};
  }

  SmallService service_;
  StoppedClock clock_;
  NoProgress progress_;
  std::vector<std::string> log_;
};

TEST_F(Upload, GoesFromAnnouncementToVerdict) {
  stage(3);
  seal();
  const UploadOutcome outcome = run();
  EXPECT_TRUE(outcome.finished);
  EXPECT_EQ(outcome.verdicts.accepted, 3);
  EXPECT_EQ(outcome.retries, 0);
  EXPECT_EQ(tiles_in(TileState::accepted), 3);
  EXPECT_TRUE(clock_.waits_ms.empty());
  EXPECT_TRUE(log_.empty());
  EXPECT_EQ(service_.calls.front(), "POST uploads");
  EXPECT_EQ(service_.calls.back(), "GET upload-0");
  EXPECT_EQ(run().verdicts.accepted, 0) << "nothing is left to do";
}

// Whatever the service says to an aircraft's report: no tile waits for it.
TEST_F(Upload, SendsReportsFirstAndOnce) {
  const auto report = [this](std::int64_t number) {
    stage_installed(*outbox_, sign_installed_report({.airframe = "mini-07",
                                                     .number = number,
                                                     .reported_at = {1'795'000'000},
                                                     .package = Sha256(),
                                                     .series = "valley",
                                                     .sequence = 1,
                                                     .root_version = 1,
                                                     .verified_at = {1'795'000'000}},
                                                    key_));
  };
  stage(1);
  seal();
  report(1);
  for (HttpResult not_now : {HttpResult(problem(503)), HttpResult(problem(404)), HttpResult(NoReply{"cut off"})}) {
    service_.first = {std::move(not_now)};
    const UploadOutcome outcome = run();
    EXPECT_EQ(outcome.reports_waiting, 1);
    EXPECT_TRUE(outcome.finished);
    EXPECT_TRUE(clock_.waits_ms.empty());
  }
  EXPECT_EQ(tiles_in(TileState::accepted), 1);
  EXPECT_EQ(service_.calls.front(), "POST installe");
  service_.first = {HttpReply{201, {}, "{}"}};
  EXPECT_EQ(run().reports_sent, 1);
  report(2);
  service_.first = {problem(409)};
  EXPECT_EQ(run().reports_sent, 1) << "the service knows a later one";
  report(3);
  service_.first = {problem(422)};
  EXPECT_EQ(run().reports_refused, 1);
  service_.calls.clear();
  run();
  EXPECT_TRUE(service_.calls.empty()) << "each is sent until there is an answer, and no longer";
}

TEST_F(Upload, PartsAreNeverLargerThanTheServiceAccepts) {
  stage(3);
  seal();
  const UploadOutcome outcome = run();
  const auto parts = std::count_if(service_.calls.begin(), service_.calls.end(),
                                   [](const std::string& call) { return call.starts_with("PATCH"); });
  EXPECT_EQ(static_cast<std::uint64_t>(parts), (outcome.body_bytes + 4095) / 4096);
}

TEST_F(Upload, WaitsAsLongAsTheServiceRequests) {
  stage(1);
  seal();
  service_.first = {problem(429, {{"retry-after", "7"}}), problem(503, {{"retry-after", "120"}})};
  EXPECT_EQ(run().verdicts.accepted, 1);
  EXPECT_EQ(clock_.waits_ms, (std::vector<std::int64_t>{7'000, 120'000}));
  EXPECT_NE(log_.at(0).find("429"), std::string::npos);
}

// By the service's clock, from its Date header: ours may be wrong by years.
TEST_F(Upload, ARetryDateIsRelativeToTheDateOfTheReply) {
  stage(1);
  seal();
  const auto until = [](const char* time) {
    return problem(503, {{"date", "Sun, 06 Nov 1994 08:49:37 GMT"}, {"retry-after", time}});
  };
  service_.first = {until("Sun, 06 Nov 1994 08:51:37 GMT"), until("Mon, 07 Nov 1994 20:00:00 GMT"),
                    until("Sun, 06 Nov 1994 08:00:00 GMT")};
  EXPECT_EQ(run({.patience_ms = 1'000'000'000}).verdicts.accepted, 1);
  EXPECT_EQ(clock_.waits_ms, (std::vector<std::int64_t>{120'000, 86'400'000})) << "a day at most; then at once";
}

TEST_F(Upload, AnInvalidRetryDateFallsBackToTheBackOff) {
  stage(1);
  seal();
  service_.first = {problem(503, {{"retry-after", "Sun, 06 Nov 2094 08:51:37 GMT"}}),
                    problem(503, {{"date", "now"}, {"retry-after", "soon"}})};
  EXPECT_EQ(run().verdicts.accepted, 1);
  ASSERT_EQ(clock_.waits_ms.size(), 2U);
  EXPECT_LT(clock_.waits_ms[0], 2'000);
  EXPECT_LT(clock_.waits_ms[1], 4'000);
}

// Each run is a program of its own that gives up at the first wait.
TEST_F(Upload, ARestartKeepsDelaysAndFailureCounts) {
  stage(2);
  seal();
  stage(4);
  seal();
  const UploadOptions impatient{.patience_ms = -1};
  service_.first = {problem(503, {{"retry-after", "600"}})};
  EXPECT_FALSE(run(impatient).finished);
  EXPECT_FALSE(run(impatient).finished);
  EXPECT_EQ(service_.calls.size(), 1U) << "neither batch is tried before the service wants it";
  EXPECT_EQ(transfer_.next_batch(clock_.now_ms() + 1'000'000)->attempts, 1);

  std::int64_t parked = 0;
  int runs = 0;
  for (; parked == 0 && runs < 50; ++runs) {
    clock_.wait(1'000'000, [] {});
    service_.first = {HttpReply{204, {}, ""}};  // nonsense
    parked += run({.patience_ms = -1, .most_invalid = 5}).parked;
    service_.first.clear();
  }
  EXPECT_EQ(parked, 2);
  EXPECT_EQ(runs, 5);
}

TEST_F(Upload, AManualRetryResetsFailureCounts) {
  stage(1);
  seal();
  const OpenBatch batch = *transfer_.next_batch(clock_.now_ms());
  EXPECT_EQ(transfer_.count_failure(batch, "forgotten"), 1);
  EXPECT_EQ(transfer_.count_failure(batch, "forgotten"), 2);
  transfer_.reset_failures(batch, {"nonsense"});
  EXPECT_EQ(transfer_.count_failure(batch, "forgotten"), 3);
  transfer_.reset_failures(batch, {"nonsense", "forgotten"});
  EXPECT_EQ(transfer_.count_failure(batch, "forgotten"), 1);
  retry_parked(*outbox_, 1);
  EXPECT_EQ(transfer_.count_failure(batch, "forgotten"), 1);
}

TEST_F(Upload, AnAttemptDelayedByAWrongClockIsDueWithinADay) {
  stage(1);
  seal();
  transfer_.delay(*transfer_.next_batch(0), 3, clock_.now_ms() + 900 * std::int64_t{86'400'000}, "no route");
  EXPECT_EQ(run({.patience_ms = 1'000'000'000}).verdicts.accepted, 1);
  EXPECT_EQ(clock_.waits_ms, (std::vector<std::int64_t>{86'400'000}));
}

TEST_F(Upload, BacksOffExponentiallyOtherwise) {
  stage(1);
  seal();
  for (int i = 0; i < 12; ++i) service_.first.push_back(NoReply{"no route"});
  EXPECT_EQ(run({.patience_ms = 1'000'000'000}).verdicts.accepted, 1);
  ASSERT_EQ(clock_.waits_ms.size(), 12U);
  for (std::size_t i = 0; i < 12; ++i) {
    EXPECT_LE(clock_.waits_ms[i], std::min<std::int64_t>(900'000, std::int64_t{2'000} << i)) << i;
  }
}

TEST_F(Upload, GivesUpAfterThePatienceLimit) {
  stage(1);
  seal();
  for (int i = 0; i < 100; ++i) service_.first.push_back(NoReply{"no route"});
  const UploadOutcome outcome = run({.patience_ms = 60'000});
  EXPECT_FALSE(outcome.finished);
  EXPECT_EQ(outcome.waits_for, "no route");
  EXPECT_EQ(tiles_in(TileState::sealed), 1);
}

TEST_F(Upload, RequestsTheOffsetAfterAnInterruption) {
  stage(2);
  seal();
  ASSERT_EQ(run().verdicts.accepted, 2);
  stage(4);
  seal();
  // Announced, then the first part is lost.
  transfer_.announced(*transfer_.next_batch(clock_.now_ms()), answer({2, 3}, {}, {}), 5);
  service_.announced = json::parse(transfer_.document(*transfer_.next_batch(clock_.now_ms())))["signed"];
  service_.calls.clear();
  service_.first = {NoReply{"reset"}};
  EXPECT_EQ(run().verdicts.accepted, 2);
  EXPECT_TRUE(service_.calls.at(0).starts_with("PATCH"));
  EXPECT_TRUE(service_.calls.at(1).starts_with("HEAD"));
}

TEST_F(Upload, TakesTheRightOffsetFromAConflict) {
  stage(2);
  seal();
  transfer_.announced(*transfer_.next_batch(0), answer({0, 1}, {}, {}), 5);
  service_.announced = json::parse(transfer_.document(*transfer_.next_batch(0)))["signed"];
  const OpenPack pack = *transfer_.next_pack(*transfer_.next_batch(0));
  service_.first = {problem(409, {{"upload-offset", std::to_string(pack.size)}})};
  const UploadOutcome outcome = run();
  EXPECT_EQ(outcome.verdicts.accepted, 2);
  EXPECT_EQ(outcome.body_bytes, pack.size) << "sent once, and then the service had it all";
}

TEST_F(Upload, WaitsForAConcurrentWriteOfThePack) {
  stage(2);
  seal();
  transfer_.announced(*transfer_.next_batch(0), answer({0, 1}, {}, {}), 5);
  service_.announced = json::parse(transfer_.document(*transfer_.next_batch(0)))["signed"];
  for (int i = 0; i < 30; ++i) {
    service_.first.push_back(problem(409, {{"upload-offset", "0"}, {"retry-after", "2"}}));
    service_.first.push_back(HttpReply{200, {{"upload-offset", "0"}}, ""});
  }
  const UploadOutcome outcome = run();
  EXPECT_EQ(outcome.parked, 0);
  EXPECT_EQ(outcome.verdicts.accepted, 2);
  EXPECT_EQ(clock_.waits_ms, std::vector<std::int64_t>(30, 2'000));
}

TEST_F(Upload, StopsImmediatelyOnARejectedToken) {
  stage(1);
  seal();
  for (const int status : {401, 403}) {
    service_.first = {problem(status)};
    EXPECT_THROW(run(), Error);
    EXPECT_EQ(tiles_in(TileState::sealed), 1);
  }
  service_.first = {HttpReply{302, {{"location", "https://elsewhere.example.org"}}, ""}};
  EXPECT_THROW(run(), Error);
}

TEST_F(Upload, ParksTilesThatTheServiceWillNeverAccept) {
  for (const int status : {400, 411, 415, 422}) {
    stage(status - 399);  // each time at least one more
    seal();
    service_.first = {problem(status)};
    EXPECT_GT(run().parked, 0) << status;
  }
}

TEST_F(Upload, AnnouncesAgainWhatTheServiceNoLongerKnows) {
  stage(2);
  seal();
  transfer_.announced(*transfer_.next_batch(0), answer({0, 1}, {}, {}), 5);
  service_.first = {problem(404)};
  EXPECT_EQ(run().verdicts.accepted, 2);
  EXPECT_EQ(service_.calls.at(1), "POST uploads");
}

TEST_F(Upload, InvalidRepliesAreRetriedALimitedNumberOfTimes) {
  stage(1);
  seal();
  for (int i = 0; i < 3; ++i) service_.first.push_back(HttpReply{200, {}, "<html>"});
  EXPECT_EQ(run().verdicts.accepted, 1);
  stage(2);
  seal();
  for (int i = 0; i < 100; ++i) service_.first.push_back(HttpReply{204, {}, ""});
  EXPECT_EQ(run().parked, 1);
}

TEST_F(Upload, AnInterruptLeavesThePackWaiting) {
  class Stop final : public Progress {
   public:
    void begin(std::string_view, std::uint64_t, std::string_view) override {}
    void advance(std::uint64_t) override {
      if (--left == 0) throw Interrupted();
    }
    void end() override {}
    int left = 3;
  };
  stage(2);
  seal();
  Stop stop;
  ServiceClient client(service_);
  Uploader uploader(*outbox_, client, {clock_, Random(1), stop, [](const std::string&) {}}, {});
  EXPECT_THROW(uploader.run(), Interrupted);
  EXPECT_EQ(run().verdicts.accepted, 2);
}

}  // namespace
}  // namespace nadir
