// What one tile costs onboard: read from the package, compared with its signed digest, decoded to pixels. Beside it
// GDAL reads the same tiles, in the same random order, from the same file; it compares nothing. Wall time, and the CPU
// time of this thread, which is less sensitive to other load.
//
//   read_tiles PACKAGE ROOT.json TILES AT
#include <fmt/format.h>
#include <gdal_priv.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <numeric>
#include <string>

#include "base/random.hpp"
#include "imagery/codecs.hpp"
#include "package/open_package.hpp"

namespace nadir {
namespace {

double now_ms(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return static_cast<double>(now.tv_sec) * 1e3 + static_cast<double>(now.tv_nsec) * 1e-6;
}

// The time of each step.
struct Times {
  std::vector<double> wall_ms, cpu_ms;

  void add(auto&& work) {
    const double wall = now_ms(CLOCK_MONOTONIC), cpu = now_ms(CLOCK_THREAD_CPUTIME_ID);
    work();
    cpu_ms.push_back(now_ms(CLOCK_THREAD_CPUTIME_ID) - cpu);
    wall_ms.push_back(now_ms(CLOCK_MONOTONIC) - wall);
  }
};

std::string percentiles(std::vector<double> ms) {
  std::sort(ms.begin(), ms.end());
  const auto at = [&](double share) {
    return ms[static_cast<std::size_t>(share * static_cast<double>(ms.size() - 1))];
  };
  return fmt::format("{:>7.3f} {:>7.3f} {:>7.3f}", at(.5), at(.99), at(1));
}

void print(const char* what, const Times& times) {
  fmt::print("{:<40} wall {}   CPU {}\n", what, percentiles(times.wall_ms), percentiles(times.cpu_ms));
}

std::vector<TileKey> some_tiles(const OpenPackage& package, std::size_t count) {
  std::vector<TileKey> keys;
  for (const Sidecar& sidecar : package.imagery().sidecars()) {
    if (sidecar.key.z == package.mission().zoom.max && sidecar.valid_ppm == kWholeTile_ppm) keys.push_back(sidecar.key);
  }
  Random random(1);
  for (std::size_t i = keys.size(); i > 1; --i) {
    std::swap(keys[i - 1], keys[static_cast<std::size_t>(random.integer(0, static_cast<int>(i) - 1))]);
  }
  keys.resize(std::min(keys.size(), count));
  return keys;
}

// Each tile once, so that GDAL's block cache never hits.
Times with_gdal(const std::filesystem::path& file, const std::vector<TileKey>& keys) {
  GDALAllRegister();
  Times times;
  auto* set = static_cast<GDALDataset*>(GDALOpen(file.c_str(), GA_ReadOnly));
  double place[6];
  if (set == nullptr || set->GetGeoTransform(place) != CE_None) return times;
  const double half_world_m = 20037508.342789244;
  std::vector<std::uint8_t> pixels(256 * 256 * 3);
  for (const TileKey& key : keys) {
    const double tile_m = 2 * half_world_m / static_cast<double>(std::uint64_t{1} << key.z);
    const int x = static_cast<int>(std::lround((key.x * tile_m - half_world_m - place[0]) / place[1]));
    const int y = static_cast<int>(std::lround((half_world_m - key.y * tile_m - place[3]) / place[5]));
    CPLErr result = CE_None;
    times.add([&] {
      result =
          set->RasterIO(GF_Read, x, y, 256, 256, pixels.data(), 256, 256, GDT_Byte, 3, nullptr, 3, 256 * 3, 1, nullptr);
    });
    if (result != CE_None) return {};
  }
  GDALClose(set);
  return times;
}

}  // namespace

int run(const std::filesystem::path& folder, const std::filesystem::path& root_file, std::size_t count, UtcTime at) {
  const TrustRoot root = read_trusted_root(root_file);
  NoProgress progress;
  Opening opening;
  Times open;
  open.add([&] {
    opening = open_package(folder,
                           {.root = &root,
                            .depth = VerifyDepth::quick,
                            .at = at,
                            .airframe = std::nullopt,
                            .state = nullptr,
                            .permit = nullptr},
                           progress);
  });
  if (!opening.package) return std::fputs("read_tiles: the package is rejected\n", stderr), 1;
  const CheckedTiles& imagery = opening.package->imagery();
  const std::vector<TileKey> keys = some_tiles(*opening.package, count);
  Times grey, colour;
  for (const auto& [times, wanted] : {std::pair{&grey, Colour::grey}, std::pair{&colour, Colour::bgr}}) {
    for (const TileKey& key : keys) {
      times->add([&] { decode_image(imagery.read(key).value(), wanted, "tile"); });
    }
  }
  fmt::print("opened and verified at quick depth: {:.0f} ms, {} tiles\n", open.wall_ms[0], imagery.sidecars().size());
  fmt::print("{:<40} p50, p99 and largest in ms, {} tiles\n", "one tile", keys.size());
  print("nadir: read, check, decode to grey", grey);
  print("nadir: read, check, decode to colour", colour);
  const auto gdal = with_gdal(folder / opening.package->manifest().artifact(kRoleImagery)->path, keys);
  if (gdal.wall_ms.empty()) return std::puts("GDAL: NOT RUN: it does not read this file"), 0;
  print("GDAL: read, decode to colour", gdal);
  return 0;
}

}  // namespace nadir

int main(int argc, char** argv) {
  if (argc != 5) return std::fputs("usage: read_tiles PACKAGE ROOT.json TILES AT\n", stderr), 2;
  try {
    return nadir::run(argv[1], argv[2], static_cast<std::size_t>(std::atol(argv[3])),
                      nadir::parse_utc(argv[4]).value());
  } catch (const std::exception& error) {
    return std::fprintf(stderr, "read_tiles: %s\n", error.what()), 2;
  }
}
