// Updates a package in a process of its own and kills itself at a given moment: at its Nth word about its progress.
//
// Usage: killed_update OLD ROOT.json MISSION MAP.tif KEY.pem OUT EVENT [cog|mbtiles [index]]
// EVENT 0: never; the number of events is printed. The container is the old one's unless it is named. Exit codes: 0
// updated; 1 rejected; 2 error; else the signal.
#include <fmt/format.h>

#include <cstdio>
#include <span>
#include <string>

#include "base/error.hpp"
#include "package_build/die_at.hpp"
#include "package_build/package_updater.hpp"

namespace {

int update(std::span<char*> args) {
  const nadir::TrustRoot root = nadir::read_trusted_root(args[2]);
  const nadir::PrivateKey key = nadir::PrivateKey::read(args[5]);
  nadir::UpdateRequest request;
  request.old_package = args[1];
  request.trust = &root;
  request.mission = args[3];
  request.imagery = {args[4]};
  request.key = &key;
  request.out = args[6];
  request.tiles.threads = 2;
  request.tiles.mosaic.order = nadir::MosaicOrder::newest;
  if (args.size() > 8) {
    request.container = args[8] == std::string_view("cog") ? nadir::TileSetKind::cog : nadir::TileSetKind::mbtiles;
  }
  request.index = args.size() > 9;
  nadir::test::DieAt progress(std::stoi(args[7]));
  if (nadir::update_package(request, progress).package.findings.has_errors()) return 1;
  fmt::print("{}\n", progress.seen());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 8) return 64;
  try {
    return update({argv, static_cast<std::size_t>(argc)});
  } catch (const nadir::Error& error) {
    fmt::print(stderr, "{}\n", error.what());
    return 2;
  }
}
