#include "imagery/map_window.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/node_grid.hpp"
#include "imagery/tile_cache.hpp"

namespace nadir {
namespace {

constexpr int kMaxWindowSide_px = 20'000;
constexpr int kWarpBlock_px = 1024;  // output pixels that are processed at once: bounds memory

struct WindowLevel {
  int zoom = 0;
  int tile_shrink = 1;  // tiles are averaged down by this before they are sampled
  int samples = 1;      // samples per output pixel, each way
};

// The factor that remains after tile_shrink is below 2; above 1.25 one sample per pixel would alias.
WindowLevel level_for(const ZoomRange& zooms, double gsd_m, double lat_deg) {
  constexpr double kRounding = 1.001;
  WindowLevel level{zooms.max, 1, 1};
  while (level.zoom > zooms.min && ground_resolution_m(level.zoom - 1, lat_deg) <= gsd_m * kRounding) --level.zoom;
  double factor = gsd_m / ground_resolution_m(level.zoom, lat_deg);
  while (factor >= 2.0 && level.tile_shrink < kTileSize) {
    level.tile_shrink *= 2;
    factor /= 2.0;
  }
  if (factor > 1.25) level.samples = std::clamp(static_cast<int>(std::ceil(factor)), 2, 8);
  return level;
}

// Positions in pixels of the (averaged) tiles, relative to `origin`, at every kMapNodeStep_px samples.
struct Nodes {
  int columns = 0;
  int rows = 0;
  GlobalPixel origin;  // whole tiles
  std::vector<cv::Point2d> places;

  const cv::Point2d& at(int row, int column) const {
    return places[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(column)];
  }
};

// How much of a tile, or of what lies under a cell between nodes, is ground.
constexpr std::uint8_t kNoGround = 0, kPartlyGround = 1, kAllGround = 2;

void keep_worst(std::optional<double>& worst, std::optional<double> value) {
  if (value && (!worst || *worst < *value)) worst = value;
}

class BlockCutter {
 public:
  BlockCutter(TileCache& cache, const LocalFrame& frame, MapWindow& window, const WindowLevel& level, Colour colour)
      : cache_(cache), frame_(frame), window_(window), level_(level), colour_(colour) {}

  void cut(const cv::Rect& block, cv::Mat image, cv::Mat mask) const {
    const cv::Size size(block.width * level_.samples, block.height * level_.samples);
    const Nodes nodes = nodes_for(block, size);
    double right = 0, bottom = 0, left = 1e9, top = 1e9;
    for (const cv::Point2d& place : nodes.places) {
      left = std::min(left, place.x), right = std::max(right, place.x);
      top = std::min(top, place.y), bottom = std::max(bottom, place.y);
    }
    const int tile = kTileSize / level_.tile_shrink;
    const cv::Rect tiles = tiles_under(left, top, right, bottom, tile);
    cv::Mat mosaic(tiles.height * tile, tiles.width * tile, colour_ == Colour::grey ? CV_8UC1 : CV_8UC3,
                   cv::Scalar::all(0));
    cv::Mat ground(mosaic.size(), CV_8UC1, cv::Scalar(0));
    const cv::Mat1b tile_ground = paste_tiles(nodes.origin, tiles, tile, mosaic, ground);

    // Where no tile lies, and under whole tiles, the mask needs no sampling: most of it, in most windows.
    const cv::Mat1b cells = ground_of_cells(nodes, tiles, tile, tile_ground);
    const cv::Rect shown = cv::boundingRect(cells);
    if (shown.empty()) {
      image.setTo(cv::Scalar::all(0));
      mask.setTo(0);
      return;
    }
    const cv::Rect whole(cv::Point(), size);
    const cv::Rect sampled = samples_of(shown) & whole;
    const cv::Mat map =
        positions(nodes, sampled, {static_cast<float>(tiles.x * tile), static_cast<float>(tiles.y * tile)});
    cv::Mat samples(size, mosaic.type(), cv::Scalar::all(0)), sample_mask(size, CV_8UC1, cv::Scalar(0));
    cv::remap(mosaic, samples(sampled), map, {}, cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar::all(0));
    for (int row = shown.y; row < shown.br().y; ++row) {
      for (int column = shown.x, end = column; column < shown.br().x; column = end) {  // cells alike side by side
        while (end < shown.br().x && cells(row, end) == cells(row, column)) ++end;
        const cv::Rect run = samples_of({column, row, end - column, 1}) & whole;
        cv::Mat part = sample_mask(run);
        if (cells(row, column) == kAllGround) part.setTo(255);
        if (cells(row, column) != kPartlyGround) continue;
        cv::remap(ground, part, map(run - sampled.tl()), {}, cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar(0));
      }
    }
    if (level_.samples > 1) {
      cv::resize(samples, image, block.size(), 0, 0, cv::INTER_AREA);
      cv::resize(sample_mask, mask, block.size(), 0, 0, cv::INTER_AREA);
    } else {
      samples.copyTo(image);
      sample_mask.copyTo(mask);
    }
    // A pixel is valid when all pixels that it was interpolated from are.
    cv::threshold(mask, mask, 254, 255, cv::THRESH_BINARY);
  }

 private:
  Nodes nodes_for(const cv::Rect& block, const cv::Size& size) const {
    Nodes nodes;
    nodes.columns = map_nodes_along(size.width);
    nodes.rows = map_nodes_along(size.height);
    const double shrink = level_.tile_shrink;
    const int tile = kTileSize / level_.tile_shrink;
    for (int row = 0; row < nodes.rows; ++row) {
      for (int column = 0; column < nodes.columns; ++column) {
        const PlanePoint point = window_.plane_from_pixel(block.x + (column * kMapNodeStep_px + 0.5) / level_.samples,
                                                          block.y + (row * kMapNodeStep_px + 0.5) / level_.samples);
        const GlobalPixel pixel = pixel_from_lonlat(frame_.lonlat_from_plane(point), level_.zoom);
        const GlobalPixel small{pixel.x / shrink, pixel.y / shrink};
        if (nodes.places.empty()) nodes.origin = {std::floor(small.x / tile) * tile, std::floor(small.y / tile) * tile};
        // cv::remap counts from pixel centres.
        nodes.places.emplace_back(small.x - nodes.origin.x - 0.5, small.y - nodes.origin.y - 0.5);
      }
    }
    return nodes;
  }

  static cv::Rect samples_of(const cv::Rect& cells) {
    constexpr int kStep = kMapNodeStep_px;
    return {cells.x * kStep, cells.y * kStep, cells.width * kStep, cells.height * kStep};
  }

  // The tiles that samples between these positions are interpolated from, and a little more.
  static cv::Rect tiles_under(double left, double top, double right, double bottom, int tile) {
    const auto first = [tile](double value) { return static_cast<int>(std::floor((value - 2) / tile)); };
    const auto last = [tile](double value) { return static_cast<int>(std::floor((value + 2) / tile)); };
    return {first(left), first(top), last(right) - first(left) + 1, last(bottom) - first(top) + 1};
  }

  // Positions of a cell lie between those of its nodes.
  static cv::Mat1b ground_of_cells(const Nodes& nodes, const cv::Rect& tiles, int tile, const cv::Mat1b& tile_ground) {
    cv::Mat1b cells(nodes.rows - 1, nodes.columns - 1);
    for (int row = 0; row < cells.rows; ++row) {
      for (int column = 0; column < cells.cols; ++column) {
        const cv::Point2d &nw = nodes.at(row, column), &ne = nodes.at(row, column + 1);
        const cv::Point2d &sw = nodes.at(row + 1, column), &se = nodes.at(row + 1, column + 1);
        const auto [left, right] = std::minmax({nw.x, ne.x, sw.x, se.x});
        const auto [top, bottom] = std::minmax({nw.y, ne.y, sw.y, se.y});
        const cv::Mat1b under = tile_ground(tiles_under(left, top, right, bottom, tile) - tiles.tl());
        const std::uint8_t any = under(0, 0);
        const bool alike = std::all_of(under.begin(), under.end(), [any](std::uint8_t one) { return one == any; });
        cells(row, column) = alike ? any : kPartlyGround;
      }
    }
    return cells;
  }

  // What each tile shows.
  cv::Mat1b paste_tiles(const GlobalPixel& origin, const cv::Rect& tiles, int tile, cv::Mat& mosaic,
                        cv::Mat& ground) const {
    cv::Mat1b shown(tiles.size(), kNoGround);
    const auto first_x = static_cast<std::int64_t>(origin.x) / tile + tiles.x;
    const auto first_y = static_cast<std::int64_t>(origin.y) / tile + tiles.y;
    const std::int64_t across = std::int64_t{1} << level_.zoom;
    for (int row = 0; row < tiles.height; ++row) {
      for (int column = 0; column < tiles.width; ++column) {
        const std::int64_t x = first_x + column, y = first_y + row;
        if (x < 0 || y < 0 || x >= across || y >= across) continue;
        const TileKey key{static_cast<std::uint8_t>(level_.zoom), static_cast<std::uint32_t>(x),
                          static_cast<std::uint32_t>(y)};
        const DecodedTile& decoded = cache_.get(key, colour_, level_.tile_shrink);
        if (decoded.image.empty()) continue;
        keep_worst(window_.ce90_m, cache_.source().ce90_m(key));
        const cv::Rect place(column * tile, row * tile, tile, tile);
        decoded.image.copyTo(mosaic(place));
        if (decoded.mask.empty()) {
          ground(place).setTo(255);
        } else {
          decoded.mask.copyTo(ground(place));
        }
        shown(row, column) = decoded.mask.empty() ? kAllGround : kPartlyGround;
      }
    }
    return shown;
  }

  // Of a part that begins at a node.
  static cv::Mat positions(const Nodes& nodes, const cv::Rect& part, cv::Point2f mosaic_origin) {
    const int above = part.y / kMapNodeStep_px, before = part.x / kMapNodeStep_px;
    return positions_between_nodes(
        part.size(), [&](int row, int column) -> const cv::Point2d& { return nodes.at(above + row, before + column); },
        [&](const cv::Point2d& begin, const cv::Point2d& end) -> NodeSegment {
          return {cv::Point2f(begin) - mosaic_origin, cv::Point2f((end - begin) / kMapNodeStep_px)};
        });
  }

  TileCache& cache_;
  const LocalFrame& frame_;
  MapWindow& window_;
  WindowLevel level_;
  Colour colour_;
};

MapWindow empty_window(const PlaneBox& box, double gsd_m, Colour colour) {
  const double columns = std::round((box.east_m - box.west_m) / gsd_m);
  const double rows = std::round((box.north_m - box.south_m) / gsd_m);
  const bool fits = gsd_m > 0 && columns >= 1 && rows >= 1 && columns <= kMaxWindowSide_px && rows <= kMaxWindowSide_px;
  if (!fits) {  // NaN does not fit either
    throw Error({.what = "a map window of this size cannot be cut",
                 .expected = fmt::format("1 to {} pixels a side and a positive GSD", kMaxWindowSide_px),
                 .found = fmt::format("{} x {} m at {} m per pixel", box.east_m - box.west_m, box.north_m - box.south_m,
                                      gsd_m)});
  }
  MapWindow window;
  window.west_m = box.west_m;
  window.north_m = box.north_m;
  window.gsd_m = gsd_m;
  const cv::Size size(static_cast<int>(columns), static_cast<int>(rows));
  window.image.create(size, colour == Colour::grey ? CV_8UC1 : CV_8UC3);
  window.mask.create(size, CV_8UC1);
  return window;
}

}  // namespace

struct MapWindowReader::Impl {
  TileCache cache;
};

MapWindowReader::MapWindowReader(const TileSource& tiles, std::size_t max_cached_tiles)
    : impl_(std::make_unique<Impl>(Impl{TileCache(tiles, max_cached_tiles)})) {}
MapWindowReader::~MapWindowReader() = default;
MapWindowReader::MapWindowReader(MapWindowReader&&) noexcept = default;
MapWindowReader& MapWindowReader::operator=(MapWindowReader&&) noexcept = default;

ZoomRange MapWindowReader::zooms() const { return impl_->cache.source().zooms(); }

MapWindow MapWindowReader::read(const LocalFrame& frame, const PlaneBox& box, double gsd_m, Colour colour) {
  MapWindow window = empty_window(box, gsd_m, colour);
  const LonLat centre = frame.lonlat_from_plane(box.middle());
  const WindowLevel level = level_for(zooms(), gsd_m, centre.lat_deg);
  const BlockCutter cutter(impl_->cache, frame, window, level, colour);
  for (int row = 0; row < window.image.rows; row += kWarpBlock_px) {
    for (int column = 0; column < window.image.cols; column += kWarpBlock_px) {
      const cv::Rect block(column, row, std::min(kWarpBlock_px, window.image.cols - column),
                           std::min(kWarpBlock_px, window.image.rows - row));
      cutter.cut(block, window.image(block), window.mask(block));
    }
  }
  return window;
}

std::optional<double> MapWindowReader::ce90_m(const LocalFrame& frame, const PlaneBox& box, double gsd_m) const {
  const LonLat centre = frame.lonlat_from_plane(box.middle());
  const int zoom = level_for(zooms(), gsd_m, centre.lat_deg).zoom;
  double west = std::numeric_limits<double>::infinity(), east = -west, north = west, south = -west;
  for (const double east_m : {box.west_m, box.east_m}) {
    for (const double north_m : {box.south_m, box.north_m}) {
      const GlobalPixel corner = pixel_from_lonlat(frame.lonlat_from_plane({east_m, north_m}), zoom);
      west = std::min(west, corner.x), east = std::max(east, corner.x);
      north = std::min(north, corner.y), south = std::max(south, corner.y);
    }
  }
  const double across = std::exp2(zoom);
  const auto tile_of = [across](double pixel) {
    return static_cast<std::uint32_t>(std::clamp(std::floor(pixel / kTileSize), 0.0, across - 1));
  };
  std::optional<double> worst;
  if (!(east - west < kMaxWindowSide_px * 8.0 && south - north < kMaxWindowSide_px * 8.0)) return worst;
  for (std::uint32_t x = tile_of(west); x <= tile_of(east); ++x) {
    for (std::uint32_t y = tile_of(north); y <= tile_of(south); ++y) {
      keep_worst(worst, impl_->cache.source().ce90_m({static_cast<std::uint8_t>(zoom), x, y}));
    }
  }
  return worst;
}

MapWindow read_map_window(const TileSource& tiles, const LocalFrame& frame, const PlaneBox& box, double gsd_m,
                          Colour colour) {
  return MapWindowReader(tiles).read(frame, box, gsd_m, colour);
}

}  // namespace nadir
