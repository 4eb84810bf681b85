// The local API of the service as a function from request to response: routes, access, the content of each path. Reads
// the FlightBoard and never touches the flight. The contract is schemas/nadird.openapi.yaml, the prose docs/api.md.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <optional>

#include "api/flight_view.hpp"
#include "api/requests.hpp"
#include "api/view_formats.hpp"
#include "base/digest.hpp"
#include "geodesy/local_frame.hpp"
#include "http/server.hpp"
#include "imagery/tile_source.hpp"
#include "service/position_hints.hpp"
#include "vision/ground_surface.hpp"

namespace nadir {

// The package as the API uses it. tiles: a reader of its own, so that the flight's never waits for a page's.
struct ApiPackage {
  std::shared_ptr<const TileSource> tiles;
  std::shared_ptr<const LocalFrame> frame;       // the plane in which `surface` gives heights
  std::shared_ptr<const GroundSurface> surface;  // null: flat
  // The bytes of its vectors, read when they are asked for; nothing: it has none. Null: there is no package.
  std::function<std::optional<Bytes>()> vectors{};
};

struct ApiOptions {
  std::function<double()> now_s;  // the clock of FlightView::time_s
  std::optional<Sha256> token{};  // digest of the bearer token that every call under /v1/ must bring
  // Digest of the one that a hint must bring where the others need none. nullopt: none.
  std::optional<Sha256> hint_token{};
  bool loopback = true;        // then the Host must be a loopback name, against DNS rebinding
  double stalled_after_s = 2;  // without a new view for so long /v1/health reports a stall
  // Changes what a recording shows, and returns what it will be: from the server's thread. Null: this is a flight.
  std::function<PlaybackView(const PlaybackRequest&)> control_playback{};
};

class Api final : public HttpHandler {
 public:
  // board, hints: must outlive this.
  Api(const FlightBoard& board, LatestSlot<Hint>& hints, ApiOptions options);

  // Once it is open, from any thread; until then, paths that need it answer that there is none.
  void use_package(ApiPackage package);

  // From any thread. Never throws.
  ApiResponse handle(const ApiRequest& request, const ServerCounts& server = {}) const;

  void on_thread_start() const override;
  void serve(ApiRequest request, const HttpAdmission& admission, const ServerCounts& counts,
             Respond respond) const override;

  // What an event stream sends next (stream_text()).
  std::string next_of_stream(StreamCursor& cursor) const;

 private:
  ApiResponse route(const ApiRequest& request, const ServerCounts& server) const;
  std::optional<Problem> access(const ApiRequest& request, std::string_view path) const;
  std::shared_ptr<const ApiPackage> package() const;
  double age_s(const FlightView& view) const;

  ApiResponse health() const;
  ApiResponse state() const;
  ApiResponse take_hint(const ApiRequest& request) const;
  ApiResponse control_playback(const ApiRequest& request) const;
  ApiResponse object_location(const ApiRequest& request) const;

  const FlightBoard& board_;
  LatestSlot<Hint>& hints_;
  ApiOptions options_;
  mutable std::mutex hint_mutex_;
  mutable HintAllowance hint_allowance_;
  mutable std::mutex package_mutex_;
  std::shared_ptr<const ApiPackage> package_ = std::make_shared<const ApiPackage>();
};

}  // namespace nadir
