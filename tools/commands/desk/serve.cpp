// nadir desk serve.
#include <fmt/format.h>

#include <chrono>
#include <filesystem>
#include <optional>
#include <ostream>
#include <string>
#include <thread>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/platform.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "cli/terminal.hpp"
#include "commands/commands.hpp"
#include "desk/desk_api.hpp"
#include "desk/desk_service.hpp"
#include "token_keys/token_key.hpp"
#include "trust/bearer_token.hpp"

namespace nadir {
namespace {

constexpr std::size_t kThreads = 4;           // of the API
constexpr std::size_t kRequestsInLane = 256;  // that wait
constexpr auto kPollInterval = std::chrono::milliseconds(100);

class DeskServeCommand final : public Command {
 public:
  std::string_view group() const override { return "desk"; }
  std::string_view name() const override { return "serve"; }
  std::string_view summary() const override { return "localize flights of pictures behind a web page and an HTTP API"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  DeskOptions desk_;
  std::string listen_ = "127.0.0.1:8770";
  std::optional<std::filesystem::path> token_file_, port_file_;
  std::optional<UtcTime> at_;
  int engines_ = 1;
  int live_flights_ = 16;
  int body_mb_ = 64;
  int keep_free_mb_ = 1024;
};

std::string_view DeskServeCommand::details() const {
  return R"(Serves a page and an API (/v1/openapi.json) on this machine until it is interrupted: pictures
arrive in batches, positions appear as they are processed, and a person helps where the map does not.
DIR receives flights/, one folder per flight; packages are found in DIR/packages. Whatever was
accepted is on the disk: the desk may be killed at any moment and goes on where it was.

At /missions it is a planner's desk: missions are drawn, and built, signed, verified and predicted by
the commands of this program, from the imagery, elevation models, cameras and keys named here.

It does not speak TLS, and answers to loopback names only. Beyond this machine it needs a token, and
a proxy that does speak TLS.)";
}

std::string_view DeskServeCommand::examples() const {
  return R"(nadir desk serve --root desk --trust root.json
nadir desk serve --root desk --trust root.json --imagery imagery --camera camera.yaml --key planner.key.pem
nadir desk serve --root desk --trust root.json --listen 0.0.0.0:8770 --token-file desk.token)";
}

void DeskServeCommand::setup(Options& options) {
  options.value("--root", desk_.root, "DIR", "folder of flights and packages; created when missing").required();
  options.value("--trust", desk_.trust, "FILE.json",
                "root of trust for the packages' signatures; without it flights have no map");
  options.value("--at", at_, "TIME", "evaluate the packages' validity as of this time; the present by default");
  options.values("--imagery", desk_.sources.imagery, "PATH",
                 "raster, or folder of rasters, that packages may be made of; besides DIR/imagery");
  options.values("--dem", desk_.sources.elevation, "PATH", "elevation model, or folder of them; besides DIR/elevation");
  options.values("--camera", desk_.sources.cameras, "PATH", "camera file, or folder of them; besides DIR/cameras");
  options.values(
      "--vectors", desk_.sources.vectors, "PATH",
      "roads, water, woods and buildings (.osm.pbf, GeoPackage, GeoJSON), or folder of them; besides DIR/vectors");
  options.value("--vectors-attribution", desk_.sources.vectors_attribution, "TEXT",
                "what the licence of vectors asks to be shown; .osm.pbf: OpenStreetMap's");
  options.value("--vectors-licence", desk_.sources.vectors_licence, "ID", "SPDX identifier of their licence");
  options.values(
      "--key", desk_.sources.keys, "KEY.pem",
      "private key (file or pkcs11: URI) that packages may be signed with; only the command that signs reads it");
  options.value("--listen", listen_, "IP:PORT", "address of the page and the API; port 0 takes any free one");
  options.value("--token-file", token_file_, "FILE", "bearer token for callers; required to listen beyond loopback");
  options.value("--engines", engines_, "N", "flights that are processed at a time").between(1, 64);
  options.value("--live-flights", live_flights_, "N", "flights that are open at a time").between(1, 256);
  options.value("--body-mb", body_mb_, "N", "largest batch of pictures in megabytes").between(1, 1024);
  options.value("--keep-free-mb", keep_free_mb_, "N", "free megabytes on the disk below which no picture is accepted")
      .between(0, 1'000'000);
  options.value("--port-file", port_file_, "FILE", "write the port here once listening");
}

// What is named must be there: a planner who mistyped a path would look for it on the page in vain.
void require_sources(const MapSourceOptions& sources) {
  const auto require = [](const char* option, const std::vector<std::filesystem::path>& paths) {
    for (const std::filesystem::path& path : paths) {
      if (std::filesystem::exists(path)) continue;
      throw UsageError({.what = "no such file or folder",
                        .where = fmt::format("{} {}", option, path.string()),
                        .expected = "a file, or a folder of files"});
    }
  };
  require("--imagery", sources.imagery);
  require("--dem", sources.elevation);
  require("--camera", sources.cameras);
  require("--vectors", sources.vectors);
  for (const std::filesystem::path& key : sources.keys) {
    if (is_token_uri(key.native())) {
      check_token_uri(key.native());
    } else {
      require("--key", {key});
    }
  }
}

int DeskServeCommand::run(Context& context) {
  require_sources(desk_.sources);
  keep_freed_memory();
  const ListenAddress address = parse_listen_address(listen_);
  DeskApiOptions options;
  if (token_file_) options.token = sha256(as_bytes(read_bearer_token(*token_file_)));
  require_token_beyond_loopback(address, options.token);
  options.loopback = address.loopback();
  options.body_bytes = std::uint64_t{static_cast<unsigned>(body_mb_)} * 1'000'000;
  options.bodies_bytes = 4 * options.body_bytes;
  desk_.at = at_;
  desk_.judged_at = [this, &context] { return evaluation_time(at_, context.clock); };
  desk_.limits.engines = static_cast<std::size_t>(engines_);
  desk_.limits.live_flights = static_cast<std::size_t>(live_flights_);
  desk_.limits.keep_free_bytes = std::uint64_t{static_cast<unsigned>(keep_free_mb_)} * 1'000'000;
  desk_.limits.pictures.picture_bytes = options.body_bytes;

  DeskService desk(desk_);
  FairQueue queue(kThreads, kRequestsInLane);
  const DeskApi api(desk, queue, options);
  const HttpServer server(api, address, desk_http_limits());
  if (port_file_) write_file_atomic(*port_file_, fmt::format("{}\n", server.port()));
  if (!context.quiet) {
    context.err << fmt::format("the desk is open at http://{}:{}/\n", address.ip, server.port()) << std::flush;
  }
  while (!interrupt_requested()) std::this_thread::sleep_for(kPollInterval);
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_desk_serve() { return std::make_unique<DeskServeCommand>(); }

}  // namespace nadir
