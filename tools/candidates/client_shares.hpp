// What each client may hold of the server at a time: requests, and memory for their bodies. For the server's one
// thread.
#pragma once

#include <cstdint>
#include <map>
#include <string>

namespace nadir {

struct ShareLimits {
  std::uint64_t bodies_bytes = std::uint64_t{64} << 20;         // of all clients together
  std::uint64_t client_bodies_bytes = std::uint64_t{24} << 20;  // of one
  std::size_t client_requests = 32;
};

class ClientShares {
 public:
  explicit ClientShares(const ShareLimits& limits) : limits_(limits) {}

  bool take(const std::string& client, std::uint64_t bytes) {
    Share& share = shares_[client];
    if (share.requests >= limits_.client_requests || share.bytes + bytes > limits_.client_bodies_bytes ||
        total_bytes_ + bytes > limits_.bodies_bytes) {
      return false;
    }
    ++share.requests;
    share.bytes += bytes;
    total_bytes_ += bytes;
    return true;
  }

  void give_back(const std::string& client, std::uint64_t bytes) {
    Share& share = shares_[client];
    --share.requests;
    share.bytes -= bytes;
    total_bytes_ -= bytes;
  }

 private:
  struct Share {
    std::size_t requests = 0;
    std::uint64_t bytes = 0;
  };
  ShareLimits limits_;
  std::uint64_t total_bytes_ = 0;
  std::map<std::string, Share> shares_;  // as many as there are tokens
};

}  // namespace nadir
