#include "http/server.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <atomic>
#include <new>
#include <thread>
#include <vector>

#include "api/api_fixture.hpp"
#include "base/error.hpp"
#include "http/raw_client.hpp"

namespace nadir {
namespace {

using test::RawClient;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::StartsWith;

constexpr const char* kGetHealth = "GET /v1/health HTTP/1.1\r\nHost: localhost\r\n\r\n";
constexpr const char* kGetEvents = "GET /v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n";

class HttpServerTest : public test::ApiFixture {
 protected:
  void serve(HttpLimits limits = {}) {
    ListenAddress any;
    any.port = 0;
    server.emplace(api, any, limits);
  }
  RawClient connect(int receive_buffer_bytes = 0) { return RawClient(server->port(), receive_buffer_bytes); }
  // Waits for the server's counters, which its own thread updates.
  template <typename Condition>
  bool eventually(Condition condition) {
    for (int i = 0; i < 6000; ++i) {
      if (condition(server->counts())) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return false;
  }

  std::optional<HttpServer> server;
};

TEST_F(HttpServerTest, AnswersSuccessiveRequestsOnAConnection) {
  serve();
  RawClient client = connect();
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(client.send(kGetHealth));
    EXPECT_THAT(client.read_until("}"), StartsWith("HTTP/1.1 200 OK\r\n"));
  }
  EXPECT_EQ(server->counts().connections_total, 1U);
  EXPECT_EQ(server->counts().requests_total, 3U);
}

TEST_F(HttpServerTest, HeadHasNoBody) {
  serve();
  RawClient client = connect();
  client.send("HEAD /v1/state HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  const std::string text = client.read_to_the_end();
  EXPECT_THAT(text, HasSubstr("Content-Length: "));
  EXPECT_THAT(text, EndsWith("\r\n\r\n"));
}

TEST_F(HttpServerTest, AnswersInvalidHttpAndCloses) {
  serve();
  for (const char* nonsense :
       {"\r\n\r\n\r\n\r\nx\r\n\r\n", "GET\r\n\r\n", "\x16\x03\x01\x02 hello\r\n\r\n", "GET / HTTP/9.9\r\n\r\n",
        "POST /v1/hint HTTP/1.1\r\nHost: localhost\r\nContent-Length: -1\r\n\r\n",
        "POST /v1/hint HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n"}) {
    RawClient client = connect();
    client.send(nonsense);
    EXPECT_THAT(client.read_to_the_end(), HasSubstr("HTTP/1.1 400 Bad Request")) << nonsense;
  }
}

TEST_F(HttpServerTest, RejectsOversizedRequests) {
  serve();
  RawClient header = connect();
  header.send("GET / HTTP/1.1\r\nHost: localhost\r\nX: " + std::string(20'000, 'x') + "\r\n\r\n");
  EXPECT_THAT(header.read_to_the_end(), HasSubstr("HTTP/1.1 431 "));
  RawClient body = connect();
  body.send(
      "POST /v1/hint HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 100000\r\n\r\n" +
      std::string(100'000, ' '));
  EXPECT_THAT(body.read_to_the_end(), HasSubstr("HTTP/1.1 413 "));
  RawClient chunks = connect();
  chunks.send("POST /v1/hint HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nffffffffffffff\r\n");
  EXPECT_THAT(chunks.read_to_the_end(), HasSubstr("HTTP/1.1 4"));
}

// A client that sends its request byte by byte, or none, does not keep its connection.
TEST_F(HttpServerTest, TimesOutAnIncompleteRequest) {
  HttpLimits limits;
  limits.request_time = std::chrono::milliseconds(50);
  serve(limits);
  RawClient silent = connect(), half = connect();
  half.send("GET /v1/health HTT");
  EXPECT_EQ(silent.read_to_the_end(), "");
  EXPECT_EQ(half.read_to_the_end(), "");
  EXPECT_TRUE(eventually([](const ServerCounts& counts) { return counts.connections_open == 0; }));
}

// More silent connections than the limit: a client that sends a request is answered, and the connection that has been
// silent longest is closed.
TEST_F(HttpServerTest, SilentConnectionsDoNotLockOthersOut) {
  HttpLimits limits;
  limits.request_time = std::chrono::hours(1);  // no time limit frees a place
  serve(limits);
  std::vector<RawClient> silent;
  for (std::size_t i = 0; i < limits.connections + 40; ++i) {
    silent.push_back(connect());
    silent.back().send(i % 2 == 0 ? "" : "GET /v1/health HTTP/1.1\r\n");
  }
  for (int i = 0; i < 3; ++i) {
    RawClient asking = connect();
    asking.send(kGetHealth);
    EXPECT_THAT(asking.read_until("}"), StartsWith("HTTP/1.1 200 OK\r\n"));
  }
  EXPECT_EQ(silent.front().read_to_the_end(), "") << "the first one was closed";
  EXPECT_EQ(server->counts().connections_refused, 0U);
  EXPECT_LE(server->counts().connections_open, limits.connections);
}

// A client that waits after a request is as idle as one that never sent any; a stream is not idle.
TEST_F(HttpServerTest, EvictsIdleConnectionsAndKeepsStreams) {
  HttpLimits limits;
  limits.connections = 3;
  limits.stream_interval = std::chrono::milliseconds(1);
  serve(limits);
  RawClient streaming = connect();
  streaming.send(kGetEvents);
  streaming.read_until("event: state");
  std::vector<RawClient> clients;
  for (int i = 0; i < 5; ++i) {
    clients.push_back(connect());
    clients.back().send(kGetHealth);
    EXPECT_THAT(clients.back().read_until("}"), HasSubstr("200 OK"));
  }
  EXPECT_EQ(clients.front().read_to_the_end(), "");
  publish(ServiceState::degraded);
  EXPECT_THAT(streaming.read_until("\"degraded\""), HasSubstr("event: log")) << "the stream was not closed";
}

// When all connections are streams, none can be evicted: the next connection is closed.
TEST_F(HttpServerTest, ClosesConnectionsBeyondTheLimitWhenNoneIsIdle) {
  HttpLimits limits;
  limits.connections = 2;
  serve(limits);
  RawClient one = connect(), two = connect();
  for (RawClient* client : {&one, &two}) {
    client->send(kGetEvents);
    client->read_until("event: state");
  }
  EXPECT_EQ(connect().read_to_the_end(), "");
  EXPECT_EQ(server->counts().connections_refused, 1U);
}

TEST_F(HttpServerTest, StreamsEvents) {
  HttpLimits limits;
  limits.stream_interval = std::chrono::milliseconds(1);
  limits.heartbeat = std::chrono::milliseconds(20);
  serve(limits);
  RawClient client = connect();
  client.send(kGetEvents);
  const std::string first = client.read_until("event: state");
  EXPECT_THAT(first, StartsWith("HTTP/1.1 200 OK\r\n"));
  EXPECT_THAT(first, HasSubstr("Content-Type: text/event-stream\r\n"));
  EXPECT_THAT(first, HasSubstr("id: script-1\nevent: log\n"));
  publish(ServiceState::degraded);
  EXPECT_THAT(client.read_until("\"degraded\""), HasSubstr("event: log"));
  EXPECT_THAT(client.read_until(kStreamHeartbeat), HasSubstr(std::string(kStreamHeartbeat)));
  RawClient resumed = connect();
  resumed.send("GET /v1/events HTTP/1.1\r\nHost: localhost\r\nLast-Event-ID: script-2\r\n\r\n");
  const std::string rest = resumed.read_until("event: state");
  EXPECT_THAT(rest, HasSubstr("id: script-3\n"));
  EXPECT_EQ(rest.find("id: script-2\n"), std::string::npos);
}

TEST_F(HttpServerTest, RejectsStreamsBeyondTheLimit) {
  HttpLimits limits;
  limits.streams = 2;
  serve(limits);
  RawClient one = connect(), two = connect(), three = connect();
  for (RawClient* client : {&one, &two}) {
    client->send(kGetEvents);
    client->read_until("event: state");
  }
  three.send(kGetEvents);
  EXPECT_THAT(three.read_to_the_end(), HasSubstr("HTTP/1.1 503 "));
  EXPECT_EQ(server->counts().streams_refused, 1U);
}

TEST_F(HttpServerTest, ReleasesADisconnectedReader) {
  serve();
  {
    RawClient client = connect();
    client.send(kGetEvents);
    client.read_until("event: state");
    EXPECT_EQ(server->counts().streams_open, 1U);
  }
  EXPECT_TRUE(
      eventually([](const ServerCounts& counts) { return counts.streams_open == 0 && counts.connections_open == 0; }));
}

// 50 readers that never read and 20 connections that never send: the flight publishes everything, and a new client gets
// the latest state. Nothing is queued for stalled readers: one that reads again finds fewer states than were published.
TEST_F(HttpServerTest, DeadClientsDoNotDelayTheFlight) {
  HttpLimits limits;
  limits.stream_interval = std::chrono::milliseconds(1);
  serve(limits);
  std::vector<RawClient> dead, silent;
  for (int i = 0; i < 50; ++i) {
    dead.push_back(connect(2048));
    dead.back().send(kGetEvents);
  }
  for (int i = 0; i < 20; ++i) silent.push_back(connect());
  ASSERT_TRUE(eventually([](const ServerCounts& counts) { return counts.streams_open == 50; }));

  constexpr int kViews = 20'000;
  const FlightView view = flight.at(now_s, ServiceState::normal);
  for (int i = 0; i < kViews; ++i) board.publish(view);
  const std::uint64_t last = board.snapshot()->version;
  EXPECT_EQ(last, static_cast<std::uint64_t>(kViews) + 1);

  RawClient asking = connect();
  asking.send("GET /v1/state HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  EXPECT_THAT(asking.read_to_the_end(), HasSubstr(fmt::format("\"version\":{}}}", last)));

  const std::string backlog = dead.front().read_until(fmt::format("\"version\":{}}}", last));
  std::size_t states = 0;
  for (std::size_t at = backlog.find("event: state"); at != std::string::npos;
       at = backlog.find("event: state", at + 1))
    ++states;
  EXPECT_LT(states, 1000U) << "states are queued for a reader that does not read";
}

TEST_F(HttpServerTest, DropsAStalledReader) {
  HttpLimits limits;
  limits.stream_interval = std::chrono::milliseconds(1);
  limits.answer_time = std::chrono::milliseconds(100);
  limits.stream_buffer_bytes = 4096;
  serve(limits);
  RawClient dead = connect(2048);
  dead.send(kGetEvents);
  const FlightView view = flight.at(now_s, ServiceState::normal);
  EXPECT_TRUE(eventually([&](const ServerCounts& counts) {
    board.publish(view);
    return counts.streams_dropped == 1 && counts.streams_open == 0;
  }));
}

TEST_F(HttpServerTest, AFailureEndsOnlyTheAffectedReader) {
  std::atomic<bool> fails = false;
  ApiOptions chosen = options();
  chosen.now_s = [&] { return fails ? throw std::bad_alloc() : now_s; };
  const Api failing(board, hints, chosen);
  HttpLimits limits;
  limits.stream_interval = std::chrono::milliseconds(1);
  HttpServer one(failing, ListenAddress{.port = 0}, limits);
  RawClient streaming(one.port()), other(one.port());
  streaming.send(kGetEvents);
  streaming.read_until("event: state");
  fails = true;
  publish(ServiceState::degraded);
  streaming.read_to_the_end();
  EXPECT_TRUE(streaming.ended());
  other.send(kGetHealth);
  EXPECT_THAT(other.read_until("}"), StartsWith("HTTP/1.1 500 "));
  fails = false;
  other.send(kGetHealth);
  EXPECT_THAT(other.read_until("}"), StartsWith("HTTP/1.1 "));
}

TEST_F(HttpServerTest, StopsWithClientsOfEveryKind) {
  serve();
  RawClient streaming = connect(), silent = connect(), half = connect();
  streaming.send(kGetEvents);
  streaming.read_until("event: state");
  half.send("GET /v1/he");
  server.reset();
  streaming.read_to_the_end();
  EXPECT_EQ(silent.read_to_the_end(), "");
}

TEST_F(HttpServerTest, AnAddressInUseIsAnError) {
  serve();
  ListenAddress taken;
  taken.port = server->port();
  EXPECT_THROW(HttpServer(api, taken), Error);
}

}  // namespace
}  // namespace nadir
