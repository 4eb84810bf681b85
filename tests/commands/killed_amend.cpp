// Puts the place index of one package into another in a process of its own, and kills itself at a given moment: at its
// Nth word about its progress.
//
// Usage: killed_amend PACKAGE INDEXED KEY.pem EVENT
// EVENT 0: never; the number of events is printed. Exit codes: 0 done; 1 refused; 2 error; else the signal.
#include <fmt/format.h>

#include <cstdio>
#include <span>
#include <string>

#include "base/error.hpp"
#include "package/package_writer.hpp"
#include "package_build/die_at.hpp"
#include "vision/place_index_files.hpp"

namespace {

namespace fs = std::filesystem;
using namespace nadir;

int amend(std::span<char*> args) {
  const fs::path package = args[1], indexed = args[2];
  const PrivateKey key = PrivateKey::read(args[3]);
  const Amendment amendment{{kRolePlaceIndex, kRolePlaceTable}, [&](const fs::path& folder) {
                              fs::copy(indexed / "index", folder / "index", fs::copy_options::recursive);
                              return std::vector{describe_file(folder, kPlaceIndexFile, kRolePlaceIndex),
                                                 describe_file(folder, kPlaceTableFile, kRolePlaceTable)};
                            }};
  test::DieAt progress(std::stoi(args[4]));
  const AmendedPackage amended = amend_package(package, load_package_manifest(package),
                                               read_mission(package / kMissionFile), amendment, &key, progress);
  if (amended.findings.has_errors()) return 1;
  fmt::print("{}\n", progress.seen());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 5) return 64;
  try {
    return amend({argv, static_cast<std::size_t>(argc)});
  } catch (const Error& error) {
    fmt::print(stderr, "{}\n", error.what());
    return 2;
  }
}
