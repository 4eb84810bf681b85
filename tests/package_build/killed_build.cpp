// Builds a package in a process of its own and kills itself at a given moment: at its Nth word about its progress.
//
// Usage: killed_build MISSION MAP.tif KEY.pem OUT THREADS fresh|resume mbtiles|cog EVENT [UID]
// EVENT 0: never; the number of events is printed. UID: the user that it builds as. Exit codes: 0 built; 1 rejected;
// 2 error, its text on stderr; else the signal.
#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <span>
#include <string>

#include "base/error.hpp"
#include "package_build/die_at.hpp"
#include "package_build/package_builder.hpp"

namespace {

int build(std::span<char*> args) {
  const nadir::PrivateKey key = nadir::PrivateKey::read(args[3]);
  if (args.size() > 9 && ::seteuid(static_cast<uid_t>(std::stoul(args[9]))) != 0) return 3;
  nadir::PackageRequest request;
  request.mission = args[1];
  request.imagery = {args[2]};
  request.key = &key;
  request.out = args[4];
  request.tiles.threads = std::stoi(args[5]);
  request.resume = args[6] == std::string_view("resume");
  if (args[7] == std::string_view("cog")) request.tiles.container = nadir::TileSetKind::cog;
  nadir::test::DieAt progress(std::stoi(args[8]));
  if (nadir::build_package(request, progress).findings.has_errors()) return 1;
  fmt::print("{}\n", progress.seen());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 9) return 64;
  try {
    return build({argv, static_cast<std::size_t>(argc)});
  } catch (const nadir::Error& error) {
    fmt::print(stderr, "{}\n", error.what());
    return 2;
  }
}
