// The API around a scripted flight, for tests from outside (page_test.py, contract_test.py): no autopilot, no camera.
//
// usage: test_api_server [--listen IP:PORT] [--token-file FILE] [--hint-token-file FILE] [--tiles FILE] [--centre
// LON,LAT] [--radius M] Prints "listening on PORT". Lines on standard input: a state's name (flies in it from now on),
// "stall" (the flight thread stops publishing), "go" (it goes on), "flap" (the camera is silent for a moment, five
// times), "chatter" (200 ordinary events), "corrupt" (a tile), "unsigned" (the link). Ends with standard input.
#include <poll.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <iostream>
#include <map>
#include <string>

#include "api/api.hpp"
#include "api/painted_tiles.hpp"
#include "api/scripted_flight.hpp"
#include "base/error.hpp"
#include "package/tile_container.hpp"
#include "trust/bearer_token.hpp"

namespace nadir {
namespace {

constexpr double kStart_s = 200;  // of the script's clock: there is a track to be seen

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

std::optional<ServiceState> state_named(const std::string& name) {
  for (const ServiceState state :
       {ServiceState::boot, ServiceState::no_package, ServiceState::awaiting_autopilot, ServiceState::relocalizing,
        ServiceState::normal, ServiceState::degraded, ServiceState::no_fix, ServiceState::failsafe}) {
    if (name == name_of(state)) return state;
  }
  return std::nullopt;
}

int serve(std::map<std::string, std::string> options) {
  const auto started = std::chrono::steady_clock::now();
  const auto now_s = [started] { return kStart_s + seconds_since(started); };
  const ListenAddress address =
      parse_listen_address(options.contains("--listen") ? options["--listen"] : "127.0.0.1:0");
  std::optional<Sha256> token;
  if (options.contains("--token-file")) token = sha256(as_bytes(read_bearer_token(options["--token-file"])));
  require_token_beyond_loopback(address, token);
  std::optional<Sha256> hint_token;
  if (options.contains("--hint-token-file"))
    hint_token = sha256(as_bytes(read_bearer_token(options["--hint-token-file"])));

  LonLat centre{8.5, 47.4};
  if (options.contains("--centre"))
    std::sscanf(options["--centre"].c_str(), "%lf,%lf", &centre.lon_deg, &centre.lat_deg);
  test::ScriptedFlight flight(centre, options.contains("--radius") ? std::stod(options["--radius"]) : 400);
  ServiceState state = ServiceState::normal;
  for (double time_s = 0; time_s < kStart_s; time_s += 1) {
    flight.at(time_s, time_s < 8                    ? ServiceState::relocalizing
                      : time_s > 90 && time_s < 120 ? ServiceState::degraded
                                                    : state);
  }

  FlightBoard board;
  board.publish(flight.at(now_s(), state));
  LatestSlot<Hint> hints;
  Api api(board, hints, {.now_s = now_s, .token = token, .hint_token = hint_token, .loopback = address.loopback()});
  std::shared_ptr<const TileSource> tiles = std::make_shared<test::PaintedTiles>();
  if (options.contains("--tiles")) tiles = open_tile_source(options["--tiles"]);
  api.use_package({.tiles = tiles, .frame = nullptr, .surface = nullptr});
  const HttpServer server(api, address);
  std::cout << "listening on " << server.port() << std::endl;

  bool silent = false;
  std::string typed;
  for (;;) {
    pollfd input{STDIN_FILENO, POLLIN, 0};
    if (::poll(&input, 1, 100) > 0) {
      char piece[256];
      const ssize_t got = ::read(STDIN_FILENO, piece, sizeof piece);
      if (got <= 0) return 0;
      typed.append(piece, static_cast<std::size_t>(got));
      for (std::size_t end = typed.find('\n'); end != std::string::npos; end = typed.find('\n')) {
        const std::string line = typed.substr(0, end);
        typed.erase(0, end + 1);
        if (line == "stall" || line == "go") silent = line == "stall";
        if (line == "corrupt") flight.corrupt_tile(now_s());
        if (line == "unsigned") flight.sign_link(false);
        for (int i = 0; line == "flap" && i < 5; ++i) {
          flight.note(now_s(), EventSeverity::warning, "state",
                      "no frames from the camera: no frame for 0." + std::to_string(41 + i) + " s");
          flight.note(now_s(), EventSeverity::info, "state", "visual position restored");
        }
        for (int i = 0; line == "chatter" && i < 200; ++i) {
          flight.note(now_s(), EventSeverity::info, "hint", "note " + std::string(static_cast<std::size_t>(i), 'x'));
        }
        if (const auto wanted = state_named(line)) state = *wanted;
      }
    }
    if (!silent) board.publish(flight.at(now_s(), state));
  }
}

}  // namespace
}  // namespace nadir

int main(int argc, char** argv) {
  std::map<std::string, std::string> options;
  for (int i = 1; i + 1 < argc; i += 2) options[argv[i]] = argv[i + 1];
  try {
    return nadir::serve(std::move(options));
  } catch (const nadir::Error& error) {
    std::cerr << "test_api_server: " << error.what() << '\n';
    return 2;
  }
}
