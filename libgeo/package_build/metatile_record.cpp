#include "package_build/metatile_record.hpp"

#include <algorithm>
#include <cstring>
#include <opencv2/core.hpp>
#include <type_traits>

namespace nadir {
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

Bytes record_of(const Metatile& metatile) {
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
  out.block(pixels_of(metatile.top.picture.bgr.clone()));
  out.block(pixels_of(metatile.top.picture.mask.clone()));
  return out.take();
}

std::optional<Metatile> metatile_from(ByteView record) {
  Reader in(record);
  Metatile metatile;
  const std::uint64_t count = in.number();
  for (std::uint64_t i = 0; i < count && in.good(); ++i) {
    EncodedTile& tile = metatile.tiles.emplace_back();
    Sidecar& s = tile.sidecar;
    s.key.z = static_cast<std::uint8_t>(in.number());
    s.key.x = static_cast<std::uint32_t>(in.number());
    s.key.y = static_cast<std::uint32_t>(in.number());
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
  if (!fill(metatile.top.picture.bgr, CV_8UC3, in.block())) return std::nullopt;
  if (!fill(metatile.top.picture.mask, CV_8UC1, in.block())) return std::nullopt;
  return in.done() ? std::optional(std::move(metatile)) : std::nullopt;
}

}  // namespace nadir
