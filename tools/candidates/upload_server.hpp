// HTTP/1.1 around an UploadApi (Boost.Beast): one thread for all connections, a few for the work, everything bounded.
//
// Nothing is believed before a token is: without one a caller gets as much as a header of a few kilobytes. A connection
// that does not finish its header or its body in time is closed; when all places are taken, the one that has been
// silent for longest makes room. Bodies together may hold so much memory and no more, each client's a part of that; of
// requests a client has so many at a time (client_shares.hpp), and they wait in a lane of its own (fair_queue.hpp). So
// a client that is slow, dead or hostile costs the others nothing but its share.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>

#include "candidates/upload_server.hpp"
#include "candidates/work_queue.hpp"
#include "candidates/upload_api.hpp"
#include "http/access.hpp"

namespace nadir {

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
  // address cannot be had.
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
