#include "package_build/metatile.hpp"

#include <algorithm>
#include <cstring>
#include <opencv2/core.hpp>
#include <type_traits>

#include "imagery/codecs.hpp"
#include "package/mission_check.hpp"

namespace nadir {
namespace {

cv::Rect tile_rect(int column, int row) { return {column * kTileSize, row * kTileSize, kTileSize, kTileSize}; }

TileGrid merged(const TileGrid& used, int across) {
  const int half = across / 2;
  TileGrid result(half);
  for (int row = 0; row < across; ++row) {
    for (int column = 0; column < across; ++column) {
      InputShares& target = result.at(column / 2, row / 2);
      const InputShares& source = used.at(column, row);
      for (const auto& [input, pixels] : source) target[input] += pixels;
    }
  }
  return result;
}

}  // namespace

TileEncoder::TileEncoder(const Mission& mission, std::span<const ImageryInput> inputs, TileEncoding encoding)
    : mission_(mission), frame_(mission_frame(mission)), inputs_(inputs), encoding_(encoding) {}

Bytes TileEncoder::encoded(const cv::Mat& bgr) const {
  return encoding_.lossless ? encode_lossless_webp(bgr) : encode_image(bgr, encoding_.format, encoding_.quality);
}

EncodedTile TileEncoder::encode(const TileKey& key, const TileCanvas& tile) const {
  EncodedTile result;
  result.sidecar.key = key;
  set_facts(result.sidecar, inputs_, tile.used);
  if (const Sector* sector = governing_sector(mission_, frame_, key); sector != nullptr) {
    result.sidecar.sector = sector->id;
  }
  const int valid = cv::countNonZero(tile.image.mask);
  if (valid == kTilePixels) {
    result.bytes = encoded(tile.image.bgr);
  } else {
    MaskedImage filled{tile.image.bgr.clone(), tile.image.mask.clone()};
    fill_invalid(filled);
    result.bytes = encoded(filled.bgr);
    result.sidecar.valid_ppm = kWholeTile_ppm * valid / kTilePixels;
    result.sidecar.mask = encode_image(tile.image.mask, ImageFormat::png);
  }
  result.sidecar.sha256 = sha256(result.bytes);
  return result;
}

MetatileCanvas compose_metatile(const TileKey& key, const TileRange& range, std::span<const LayerReader> layers,
                                double feather_px) {
  const int steps = range.zoom - key.z, across = 1 << steps;
  const std::int64_t x = std::int64_t{key.x} << steps, y = std::int64_t{key.y} << steps;
  const std::int64_t first_x = std::max(x, range.first_x), last_x = std::min(x + across - 1, range.last_x);
  const std::int64_t first_y = std::max(y, range.first_y), last_y = std::min(y + across - 1, range.last_y);

  MetatileCanvas canvas{{cv::Mat::zeros(across * kTileSize, across * kTileSize, CV_8UC3),
                         cv::Mat::zeros(across * kTileSize, across * kTileSize, CV_8UC1)},
                        TileGrid(across)};
  if (first_x <= last_x && first_y <= last_y) {
    const auto pixels = [](std::int64_t tiles) { return static_cast<int>(tiles) * kTileSize; };
    const cv::Rect rect(pixels(first_x), pixels(first_y), pixels(last_x - first_x + 1), pixels(last_y - first_y + 1));
    compose_layers(range.zoom, rect, {pixels(first_x - x), pixels(first_y - y)}, feather_px, layers, canvas.image,
                   canvas.used);
  }
  return canvas;
}

TileCanvas cut_metatile(const TileKey& key, int finest, MetatileCanvas canvas, const VisitTile& visit) {
  auto& [image, used] = canvas;
  const int steps = finest - key.z;
  for (int step = 0, across = 1 << steps; step <= steps; ++step, across /= 2) {
    for (int column = 0; column < across; ++column) {
      for (int row = 0; row < across; ++row) {
        const cv::Rect rect = tile_rect(column, row);
        const TileCanvas tile{{image.bgr(rect), image.mask(rect)}, used.at(column, row)};
        if (cv::countNonZero(tile.image.mask) == 0) continue;
        visit({static_cast<std::uint8_t>(finest - step), (key.x << (steps - step)) + static_cast<std::uint32_t>(column),
               (key.y << (steps - step)) + static_cast<std::uint32_t>(row)},
              tile);
      }
    }
    if (step == steps) break;
    image = halved(image);
    used = merged(used, across);
  }
  return {image, used.at(0, 0)};
}

Metatile render_metatile(const TileKey& key, const TileRange& range, std::span<const LayerReader> layers,
                         double feather_px, const TileEncoder& encoder) {
  Metatile result;
  result.top = cut_metatile(
      key, range.zoom, compose_metatile(key, range, layers, feather_px),
      [&](const TileKey& tile_key, const TileCanvas& tile) { result.tiles.push_back(encoder.encode(tile_key, tile)); });
  return result;
}

namespace {

class Writer {
 public:
  void number(std::integral auto value) {
    const auto wide = static_cast<std::uint64_t>(value);
    for (int shift = 56; shift >= 0; shift -= 8) bytes_.push_back(static_cast<std::uint8_t>(wide >> shift));
  }
  void block(ByteView bytes) {
    number(bytes.size());
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
  }
  void shares(const InputShares& used) {
    number(used.size());
    for (const auto& [input, pixels] : used) number(input), number(pixels);
  }
  Bytes take() { return std::move(bytes_); }

 private:
  Bytes bytes_;
};

class Reader {
 public:
  explicit Reader(ByteView bytes) : rest_(bytes) {}

  std::uint64_t number() {
    std::uint64_t value = 0;
    for (const std::uint8_t byte : some(8)) value = value << 8 | byte;
    return value;
  }
  std::int64_t whole() { return static_cast<std::int64_t>(number()); }
  ByteView block() { return some(number()); }
  InputShares shares() {
    InputShares used;
    const std::uint64_t count = number();
    for (std::uint64_t i = 0; i < count && good_; ++i) {
      const std::uint64_t input = number();
      if (!used.empty() && input <= used.rbegin()->first) good_ = false;  // as a map writes them
      used[static_cast<std::size_t>(input)] = number();
    }
    return used;
  }
  bool good() const { return good_; }
  bool done() const { return good_ && rest_.empty(); }

 private:
  ByteView some(std::uint64_t size) {
    if (size > rest_.size()) {
      good_ = false;
      return {};
    }
    const ByteView part = rest_.first(size);
    rest_ = rest_.subspan(size);
    return part;
  }
  ByteView rest_;
  bool good_ = true;
};

ByteView pixels_of(const cv::Mat& continuous) { return {continuous.data, continuous.total() * continuous.elemSize()}; }

bool fill(cv::Mat& target, int type, ByteView pixels) {
  target.create(kTileSize, kTileSize, type);
  if (pixels.size() != pixels_of(target).size()) return false;
  std::memcpy(target.data, pixels.data(), pixels.size());
  return true;
}

}  // namespace

Bytes serialize_metatile(const Metatile& metatile) {
  Writer out;
  out.number(metatile.tiles.size());
  for (const EncodedTile& tile : metatile.tiles) {
    const Sidecar& s = tile.sidecar;
    out.number(s.key.z), out.number(s.key.x), out.number(s.key.y);
    out.block(ByteView(s.sha256.bytes));
    out.block(as_bytes(s.source));
    out.number(s.captured_at.unix_s), out.number(s.gsd_mm), out.number(s.ce90_mm);
    out.block(as_bytes(s.sector));
    out.number(s.valid_ppm);
    out.block(s.mask);
    out.block(tile.bytes);
  }
  out.shares(metatile.top.used);
  out.block(pixels_of(metatile.top.image.bgr.clone()));
  out.block(pixels_of(metatile.top.image.mask.clone()));
  return out.take();
}

std::optional<Metatile> parse_metatile(ByteView record) {
  Reader in(record);
  Metatile metatile;
  const std::uint64_t count = in.number();
  for (std::uint64_t i = 0; i < count && in.good(); ++i) {
    EncodedTile& tile = metatile.tiles.emplace_back();
    Sidecar& s = tile.sidecar;
    const std::uint64_t z = in.number(), x = in.number(), y = in.number();
    if (z > kMaxZoom || x >> z != 0 || y >> z != 0) return std::nullopt;
    s.key = {static_cast<std::uint8_t>(z), static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y)};
    const ByteView digest = in.block();
    if (digest.size() != s.sha256.bytes.size()) return std::nullopt;
    std::copy(digest.begin(), digest.end(), s.sha256.bytes.begin());
    s.source = as_text(in.block());
    s.captured_at.unix_s = in.whole(), s.gsd_mm = in.whole(), s.ce90_mm = in.whole();
    s.sector = as_text(in.block());
    s.valid_ppm = in.whole();
    const ByteView mask = in.block();
    s.mask.assign(mask.begin(), mask.end());
    const ByteView bytes = in.block();
    tile.bytes.assign(bytes.begin(), bytes.end());
  }
  metatile.top.used = in.shares();
  if (!fill(metatile.top.image.bgr, CV_8UC3, in.block())) return std::nullopt;
  if (!fill(metatile.top.image.mask, CV_8UC1, in.block())) return std::nullopt;
  return in.done() ? std::optional(std::move(metatile)) : std::nullopt;
}

}  // namespace nadir
