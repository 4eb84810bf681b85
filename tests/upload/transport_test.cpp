// Servers on real sockets that are slow in their ways, and what the transport makes of them.
#include "upload/transport.hpp"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <string>
#include <thread>

namespace nadir {
namespace {

using ::testing::HasSubstr;

// Takes one connection, reads what comes first and hands the socket on.
class OneAnswer {
 public:
  explicit OneAnswer(std::function<void(int)> answer) : listener_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t length = sizeof address;
    EXPECT_EQ(::bind(listener_, reinterpret_cast<sockaddr*>(&address), length), 0);
    EXPECT_EQ(::listen(listener_, 1), 0);
    EXPECT_EQ(::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &length), 0);
    port_ = ntohs(address.sin_port);
    thread_ = std::jthread([this, answer = std::move(answer)] {
      const int client = ::accept(listener_, nullptr, nullptr);
      char request[4096];
      if (::recv(client, request, sizeof request, 0) > 0) answer(client);
      ::close(client);
    });
  }
  ~OneAnswer() {
    ::shutdown(listener_, SHUT_RDWR);
    thread_.join();
    ::close(listener_);
  }
  std::string address() const { return "http://127.0.0.1:" + std::to_string(port_); }

 private:
  int listener_;
  int port_ = 0;
  std::jthread thread_;
};

bool say(int client, const std::string& text) {
  return ::send(client, text.data(), text.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(text.size());
}

HttpResult ask(const OneAnswer& server) {
  CurlTransport transport({.address = server.address(),
                           .token = "token",
                           .authorities = std::nullopt,
                           .stall_timeout_s = 2,
                           .request_timeout_s = 120},
                          [] {});
  return transport.exchange({.method = "GET", .path = "/v1/uploads/x"});
}

// Two bytes a second: above every limit on silence. It would go on for as long as a request may take.
TEST(CurlTransportTest, AbortsATricklingReply) {
  std::atomic<int> sent = 0;
  const OneAnswer server([&sent](int client) {
    if (!say(client, "HTTP/1.1 200 OK\r\nContent-Length: 100000\r\n\r\n")) return;
    while (say(client, "x")) {
      ++sent;
      std::this_thread::sleep_for(std::chrono::milliseconds(500));
    }
  });
  const HttpResult result = ask(server);
  const auto* none = std::get_if<NoReply>(&result);
  ASSERT_NE(none, nullptr);
  EXPECT_THAT(none->why, HasSubstr("slower than 512 bytes/s"));
  EXPECT_GT(sent, 2) << "it was given a while";
}

TEST(CurlTransportTest, AbortsATricklingHeader) {
  const OneAnswer server([](int client) {
    say(client, "HTTP/1.1 200 OK\r\n");
    for (int i = 0; say(client, "X-" + std::to_string(i) + ": x\r\n"); ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(500));
    }
  });
  EXPECT_TRUE(std::holds_alternative<NoReply>(ask(server)));
}

// A line of 2 kB/s takes longer than the limit for its reply, and gets it.
TEST(CurlTransportTest, WaitsForASlowLine) {
  const std::string body(8'000, 'x');
  const OneAnswer server([&body](int client) {
    say(client, "HTTP/1.1 200 OK\r\nConnection: close\r\nContent-Length: 8000\r\n\r\n");
    for (std::size_t at = 0; at < body.size(); at += 1000) {
      std::this_thread::sleep_for(std::chrono::milliseconds(500));
      if (!say(client, body.substr(at, 1000))) return;
    }
  });
  const HttpResult result = ask(server);
  ASSERT_TRUE(std::holds_alternative<HttpReply>(result)) << std::get<NoReply>(result).why;
  EXPECT_EQ(std::get<HttpReply>(result).body, body);
}

}  // namespace
}  // namespace nadir
