// An UploadApi behind HTTP (http/server.hpp): admission by token, work in the queue's threads.
//
// Nothing is trusted before a token is checked: without one a caller gets a header of a few kilobytes read. Bodies
// together may take so much memory and no more, those of each client a part of that; each client has so many requests
// at a time (ShareLimits), and they wait in a lane of its own (http/fair_queue.hpp). When all places are taken, the
// connection that has been idle for longest makes room. So a client that is slow, dead or hostile costs the others
// nothing but its own share.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>

#include "http/access.hpp"
#include "http/fair_queue.hpp"
#include "nadir_candidates/upload_api.hpp"

namespace nadir {

// What each client may hold of the server at a time: requests, and memory for their bodies.
struct ShareLimits {
  std::uint64_t bodies_bytes = std::uint64_t{64} << 20;         // of all clients together
  std::uint64_t client_bodies_bytes = std::uint64_t{24} << 20;  // of one
  std::size_t client_requests = 32;
};

struct UploadServerLimits {
  std::uint32_t header_bytes = 8 * 1024;
  std::size_t connections = 256;
  ShareLimits shares{};
  std::chrono::milliseconds header_time{15'000};  // the wait for a request included
  std::chrono::milliseconds body_time{15'000};    // and more by its size:
  std::uint64_t slowest_bytes_s = 8 * 1024;
  std::chrono::milliseconds answer_time{30'000};
  std::chrono::milliseconds linger_time{2'000};  // for a client to stop sending before its connection is closed
};

class UploadServer {
 public:
  // Listens at once. api, queue: must outlive this; the queue is stopped at this server's end. Throws Error when the
  // address is not available.
  UploadServer(const UploadApi& api, FairQueue& queue, const ListenAddress& address,
               const UploadServerLimits& limits = {});
  ~UploadServer();  // closes every connection
  UploadServer(const UploadServer&) = delete;
  UploadServer& operator=(const UploadServer&) = delete;

  std::uint16_t port() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nadir
