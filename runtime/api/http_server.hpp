// HTTP/1.1 around an Api: one thread for all connections (Boost.Beast), everything bounded.
//
// A connection that does not finish its request in time, does not read its answer or is one too many is closed. An
// event stream has one piece of text in flight at most; what comes meanwhile is not queued (event_stream.hpp). So
// clients that are slow, dead or hostile cost a bounded amount of memory and nothing of the flight.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>

#include "api/api.hpp"
#include "http/listen.hpp"

namespace nadir {

struct HttpLimits {
  std::uint32_t header_bytes = 8 * 1024;
  std::uint64_t body_bytes = 16 * 1024;
  std::size_t connections = 160;
  std::size_t streams = 64;
  int stream_buffer_bytes = 32 * 1024;             // of the socket: what a reader may lag behind
  std::chrono::milliseconds request_time{15'000};  // for a whole request, the wait for it included
  std::chrono::milliseconds answer_time{15'000};   // for a whole answer, or a piece of a stream, to be taken
  std::chrono::milliseconds linger_time{2'000};    // for a client to stop sending before its connection is closed
  std::chrono::milliseconds stream_interval{200};  // between looks at the board
  std::chrono::milliseconds heartbeat{2'000};      // a stream is never silent for longer
};

class HttpServer {
 public:
  // Listens at once. api: must outlive this. Throws Error when the address cannot be had.
  HttpServer(const Api& api, const ListenAddress& address, const HttpLimits& limits = {});
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
