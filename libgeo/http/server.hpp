// HTTP/1.1 for our services: one thread for all connections (Boost.Beast), everything bounded.
//
// A connection reads a header, asks the handler whether a body may follow, reads that body, has the request answered
// and writes the response; then the next request, until one side closes. A response may go on as an event stream
// (ApiResponse::stream): at most one piece of text is in flight, nothing is queued. A connection that exceeds a time
// limit is closed, and when all places are taken, the connection that has waited longest for its client makes room: for
// a request that does not come, or a response that is not taken. Streams and busy requests stay. So a client that is
// slow, dead or hostile costs a bounded amount of memory and nothing else, and silent connections lock nobody out.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string_view>
#include <variant>

#include "http/access.hpp"
#include "http/message.hpp"

namespace nadir {

struct HttpLimits {
  std::uint32_t header_bytes = 8 * 1024;
  std::uint64_t body_bytes = 16 * 1024;
  std::size_t connections = 160;  // more than streams, so that there is always one to evict

  std::chrono::milliseconds request_time{15'000};        // for a whole request, the wait for it included
  std::optional<std::chrono::milliseconds> body_time{};  // set: request_time is for the header, this for the body,
  std::uint64_t slowest_bytes_s = 8 * 1024;              // plus its size at this rate
  std::chrono::milliseconds answer_time{15'000};         // for a response, or a piece of a stream, to be taken
  std::chrono::milliseconds linger_time{2'000};          // for a client to stop sending before its connection is closed

  std::size_t streams = 64;
  int stream_buffer_bytes = 32 * 1024;             // of the socket: how far a reader may lag
  std::chrono::milliseconds stream_interval{200};  // between looks for new text
  std::chrono::milliseconds heartbeat{2'000};      // the longest silence of a stream
};

// What a stream begins with, and what it says when there is nothing new.
inline constexpr std::string_view kStreamHello = "retry: 2000\n\n";
inline constexpr std::string_view kStreamHeartbeat = ": alive\n\n";

struct ServerCounts {
  std::uint64_t connections_open = 0, connections_total = 0, connections_refused = 0;
  std::uint64_t requests_total = 0;
  std::uint64_t streams_open = 0, streams_refused = 0, streams_dropped = 0;  // dropped: too slow, or dead
};

// A request whose header was accepted. Handlers derive from it to carry what they found out, or resources that the
// request holds: it lives until the response is written or the connection is gone.
struct HttpAdmission {
  virtual ~HttpAdmission() = default;
  bool busy = false;             // not idle while it is read and answered: never evicted
  std::uint64_t body_bytes = 0;  // announced; only body_time depends on it
};

class HttpHandler {
 public:
  // Sends the response. Exactly once, from any thread.
  using Respond = std::function<void(ApiResponse)>;

  virtual ~HttpHandler() = default;

  // In the server's thread, before anything else.
  virtual void on_thread_start() const {}
  // Before a byte of the body is read: a response refuses the request. In the server's thread, so quick.
  virtual std::variant<std::shared_ptr<HttpAdmission>, ApiResponse> admit(const ApiRequest& header) const;
  // The whole request, in the server's thread. Whatever takes time answers from another thread.
  virtual void serve(ApiRequest request, const HttpAdmission& admission, const ServerCounts& counts,
                     Respond respond) const = 0;
  // After the server's thread has ended: no call of serve() may be unfinished when this returns.
  virtual void on_stopped() const {}
};

class HttpServer {
 public:
  // Listens at once. handler: must outlive this. Throws Error when the address is not available.
  HttpServer(const HttpHandler& handler, const ListenAddress& address, const HttpLimits& limits = {});
  ~HttpServer();  // closes every connection
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  std::uint16_t port() const;
  ServerCounts counts() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nadir
