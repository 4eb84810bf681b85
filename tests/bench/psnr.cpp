// How much the finest tiles of a set differ from a lossless raster on the same grid: peak signal to noise ratio in dB,
// over the pixels of tiles that the raster covers completely. Prints the ratio and the number of such tiles.
//
//   psnr REFERENCE.tif FILE.mbtiles|FILE.tif|FOLDER     (a folder of z/x/y.png, y from the north)
//
// The reference: EPSG:3857, pixels of the zoom, bands red, green, blue and alpha.
#include <fmt/format.h>
#include <gdal_priv.h>

#include <cmath>
#include <cstdio>
#include <exception>
#include <functional>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "imagery/codecs.hpp"
#include "package/tile_container.hpp"

namespace nadir {
namespace {

constexpr double kHalfWorld_m = 20037508.342789244;

class Reference {
 public:
  explicit Reference(const char* path) : set_(static_cast<GDALDataset*>(GDALOpen(path, GA_ReadOnly))) {
    if (set_ == nullptr || set_->GetRasterCount() != 4 || set_->GetGeoTransform(place_) != CE_None) {
      throw Error({.what = "not a georeferenced raster with red, green, blue and alpha", .where = path});
    }
    zoom = static_cast<int>(std::lround(std::log2(2 * kHalfWorld_m / (256 * place_[1]))));
  }
  ~Reference() { GDALClose(set_); }
  Reference(const Reference&) = delete;
  Reference& operator=(const Reference&) = delete;

  // Blue, green, red; empty where the raster does not cover the whole tile.
  cv::Mat tile(const TileKey& key) const {
    const double tile_m = 256 * place_[1];
    const int x = static_cast<int>(std::lround((key.x * tile_m - kHalfWorld_m - place_[0]) / place_[1]));
    const int y = static_cast<int>(std::lround((place_[3] - kHalfWorld_m + key.y * tile_m) / place_[1]));
    if (x < 0 || y < 0 || x + 256 > set_->GetRasterXSize() || y + 256 > set_->GetRasterYSize()) return {};
    cv::Mat bgra(256, 256, CV_8UC4);
    int bands[] = {3, 2, 1, 4};
    if (set_->RasterIO(GF_Read, x, y, 256, 256, bgra.data, 256, 256, GDT_Byte, 4, bands, 4, 1024, 1, nullptr) !=
        CE_None) {
      throw Error({.what = "GDAL cannot read the reference"});
    }
    cv::Mat alpha, bgr(256, 256, CV_8UC3);
    cv::extractChannel(bgra, alpha, 3);
    if (cv::countNonZero(alpha != 255) != 0) return {};
    const int copied[] = {0, 0, 1, 1, 2, 2};
    cv::mixChannels({bgra}, {bgr}, copied, 3);
    return bgr;
  }

  int zoom = 0;

 private:
  GDALDataset* set_;
  double place_[6] = {};
};

using Visit = std::function<void(const TileKey&, ByteView)>;

void each_tile(const std::filesystem::path& tiles, int zoom, const Visit& visit) {
  if (std::filesystem::is_directory(tiles)) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(tiles / std::to_string(zoom))) {
      if (!entry.is_regular_file() || entry.path().extension() != ".png") continue;
      const auto x = static_cast<std::uint32_t>(std::stoul(entry.path().parent_path().filename()));
      const auto y = static_cast<std::uint32_t>(std::stoul(entry.path().stem()));
      visit({static_cast<std::uint8_t>(zoom), x, y}, read_file(entry.path()));
    }
    return;
  }
  const auto container = open_tile_container(tiles);
  for (const auto row = container->tiles(true); row->next();) {
    if (const auto key = row->key(); key && key->z == zoom) visit(*key, row->bytes());
  }
}

}  // namespace

void compare(const char* reference_file, const char* tiles) {
  GDALAllRegister();
  const Reference reference(reference_file);
  double squares = 0;
  std::uint64_t count = 0;
  each_tile(tiles, reference.zoom, [&](const TileKey& key, ByteView bytes) {
    const cv::Mat expected = reference.tile(key);
    if (expected.empty()) return;
    const double error = cv::norm(expected, decode_image(bytes, Colour::bgr, to_text(key)).image, cv::NORM_L2);
    squares += error * error, ++count;
  });
  if (count == 0) throw Error({.what = "no tile lies completely inside the reference", .where = tiles});
  const double mean = squares / (static_cast<double>(count) * 256 * 256 * 3);
  fmt::print("{:.3f} {}\n", 10 * std::log10(255 * 255 / mean), count);
}

}  // namespace nadir

int main(int argc, char** argv) {
  if (argc != 3) return std::fputs("usage: psnr REFERENCE.tif TILES\n", stderr), 2;
  try {
    nadir::compare(argv[1], argv[2]);
  } catch (const std::exception& error) {
    return std::fprintf(stderr, "psnr: %s\n", error.what()), 2;
  }
  return 0;
}
