// The HTTP API of a desk (schemas/desk.openapi.json, docs/desk.md) on http/server.hpp.
//
// A request is looked at twice. Its header decides whether it is answered at all: host, token, path, method, type and
// size of a body; all bodies together may take so much memory. The work is done by the queue's threads, each flight's
// in a lane of its own, so that a large upload delays neither another flight nor an event stream.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>

#include "desk/desk_service.hpp"
#include "desk/frame_geometry.hpp"
#include "desk/placed_look.hpp"
#include "http/fair_queue.hpp"
#include "http/server.hpp"

namespace nadir {

struct DeskApiOptions {
  std::optional<Sha256> token;  // digest of the bearer token that every call under /v1/ must bring
  bool loopback = true;         // then the Host must be a loopback name, against DNS rebinding
  std::uint64_t body_bytes = std::uint64_t{64} << 20;     // of a batch of pictures
  std::uint64_t bodies_bytes = std::uint64_t{256} << 20;  // of all requests together
};

// The server's limits for a desk: 64 event streams, time for large bodies.
HttpLimits desk_http_limits();

struct DeskRoute;

class DeskApi final : public HttpHandler {
 public:
  // Both must outlive this; the queue is stopped when the server is.
  DeskApi(DeskService& desk, FairQueue& queue, DeskApiOptions options);

  std::variant<std::shared_ptr<HttpAdmission>, ApiResponse> admit(const ApiRequest& header) const override;
  void serve(ApiRequest request, const HttpAdmission& admission, const ServerCounts& counts,
             Respond respond) const override;
  void on_stopped() const override { queue_.stop(); }

  // Both steps in the calling thread. Never throws.
  ApiResponse handle(const ApiRequest& request) const;

 private:
  ApiResponse answered(const DeskRoute& route, const ApiRequest& request) const;
  ApiResponse dispatch(const DeskRoute& route, const ApiRequest& request) const;
  ApiResponse flight_call(const DeskRoute& route, const ApiRequest& request,
                          const std::shared_ptr<LiveFlight>& flight) const;
  ApiResponse look(const DeskRoute& route, const LiveFlight& flight) const;
  FlightGround ground_of(const FlightStore& store) const;
  ApiResponse create(const ApiRequest& request) const;
  ApiResponse take_pictures(const ApiRequest& request, LiveFlight& flight) const;
  ApiResponse picture(const ApiRequest& request, std::size_t frame, const FlightStore& store) const;

  DeskService& desk_;
  FairQueue& queue_;
  const DeskApiOptions options_;
  mutable std::atomic<std::uint64_t> bodies_bytes_ = 0;  // of all admitted requests
  mutable PlacedLooks placed_looks_;
  mutable std::mutex decoding_;  // one preview at a time: a large PNG takes memory
};

}  // namespace nadir
