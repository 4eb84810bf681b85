#include "package_build/tile_set_updater.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <opencv2/core.hpp>
#include <optional>
#include <set>
#include <tuple>

#include "base/error.hpp"
#include "base/ordered_work.hpp"
#include "geodesy/angles.hpp"
#include "package/mission_check.hpp"
#include "package/open_package.hpp"
#include "package/tile_image.hpp"
#include "raster/mosaic.hpp"
#include "raster/single_opencv_thread.hpp"

namespace nadir {
namespace {

// Reads the old tiles: as bytes to copy, and as images below new imagery. Every tile is hashed when it is read and
// compared with the verified digest; one that differs or does not decode counts as missing and gives a finding. Thread
// safe.
class OldTiles {
 public:
  // mission: the new one, whose sectors the copied tiles get.
  OldTiles(const std::filesystem::path& tiles, std::vector<Sidecar> sidecars, const Mission& mission);

  const std::vector<Sidecar>& sidecars() const { return tiles_.sidecars(); }
  const Sidecar* sidecar(const TileKey& key) const { return tiles_.sidecar(key); }

  // The unchanged tile, bytes and sidecar; only its sector is that of the new mission.
  std::optional<EncodedTile> copy(const TileKey& key) const;

  // The tile's pixels; the mask is 0 throughout where there is no tile.
  MaskedImage image(const TileKey& key) const;

  // Of what has been read so far.
  Findings findings() const;

 private:
  std::optional<MaskedImage> decode(const TileKey& key, ByteView bytes) const;

  CheckedTiles tiles_;
  const Mission& mission_;
  LocalFrame frame_;
  mutable std::mutex mutex_;
  mutable Findings undecodable_;
};

// The layers of an updated map: new rasters and origins of old tiles. Origins that are neighbours in the order are one
// layer, so that nothing fades between them.
class UpdateLayers {
 public:
  // old must outlive this.
  UpdateLayers(std::vector<ImageryInput> rasters, const OldTiles& old, MosaicOrder order);

  // New rasters and old origins, the topmost first: what InputShares refer to.
  const std::vector<ImageryInput>& inputs() const { return inputs_; }
  bool is_new(std::size_t input) const { return !inputs_[input].path.empty(); }

  // For one thread; opens the rasters. This must outlive them.
  std::vector<LayerReader> readers() const;

  // From shares by layer in a tile of the finest zoom, as compose_layers() records them, to shares by input.
  InputShares by_input(const TileKey& finest, const InputShares& by_layer) const;
  // The shares of an old tile of any zoom, in pixels of the finest zoom; empty when there is none.
  InputShares of_old(const TileKey& key) const;

  // Whether a new raster may show in the tile: the box of its outline touches it.
  bool may_touch(const TileKey& key) const;

 private:
  struct Layer {
    std::size_t first = 0;  // of its inputs
    bool old = false;
  };
  using Origin = std::tuple<std::string, std::int64_t, std::int64_t, std::int64_t, TileTrust>;
  static Origin origin_of(const Sidecar& sidecar);
  MaskedImage read_old(std::size_t layer, int zoom, const cv::Rect& pixels) const;

  const OldTiles& old_;
  int finest_;
  std::vector<ImageryInput> inputs_;
  std::map<Origin, std::size_t> origins_;  // to the input
  std::vector<Layer> layers_;
  std::vector<std::size_t> layer_of_;  // by input
};

// What all steps of an update refer to.
struct UpdateContext {
  const OldTiles& old;
  const UpdateLayers& layers;
  const TileRange& range;  // wanted tiles of the finest zoom
  const TileEncoder& encoder;
  double feather_px = 0;
};

struct UpdatedMetatile {
  Metatile metatile;
  UpdateCounts counts;
  bool changed = false;  // at least one tile is not a copy
};

MaskedImage blank_image() {
  return {cv::Mat::zeros(kTileSize, kTileSize, CV_8UC3), cv::Mat::zeros(kTileSize, kTileSize, CV_8UC1)};
}

OldTiles::OldTiles(const std::filesystem::path& tiles, std::vector<Sidecar> sidecars, const Mission& mission)
    : tiles_(InputFile(tiles), std::move(sidecars)), mission_(mission), frame_(mission_frame(mission)) {}

std::optional<EncodedTile> OldTiles::copy(const TileKey& key) const {
  const Sidecar* sidecar = tiles_.sidecar(key);
  if (sidecar == nullptr) return std::nullopt;
  std::optional<Bytes> bytes = tiles_.read(key);
  if (!bytes) return std::nullopt;
  EncodedTile tile{*sidecar, std::move(*bytes)};
  const Sector* sector = governing_sector(mission_, frame_, key);
  tile.sidecar.sector = sector == nullptr ? std::string() : sector->id;
  return tile;
}

MaskedImage OldTiles::image(const TileKey& key) const {
  const std::optional<Bytes> bytes = tiles_.read(key);
  if (!bytes) return blank_image();
  return decode(key, *bytes).value_or(blank_image());
}

std::optional<MaskedImage> OldTiles::decode(const TileKey& key, ByteView bytes) const {
  const auto report_undecodable = [&](std::string found) {
    const std::lock_guard lock(mutex_);
    undecodable_.add({.code = "tile.undecodable",
                      .where = "tile " + to_text(key),
                      .expected = fmt::format("an image of {0} x {0} pixels", kTileSize),
                      .found = std::move(found)});
    return std::nullopt;
  };
  try {
    DecodedImage decoded = decode_image(bytes, Colour::bgr, "tile " + to_text(key));
    if (decoded.image.size() != cv::Size(kTileSize, kTileSize)) {
      return report_undecodable(fmt::format("{} x {}", decoded.image.cols, decoded.image.rows));
    }
    MaskedImage image{decoded.image, cv::Mat(kTileSize, kTileSize, CV_8UC1, cv::Scalar(255))};
    if (!decoded.alpha.empty()) image.mask = decoded.alpha >= 128;
    if (const auto png = tiles_.read_mask(key)) {
      const std::optional<Bytes> mask = decode_tile_mask(*png);
      if (!mask) return report_undecodable("a mask that cannot be decoded");
      std::copy(mask->begin(), mask->end(), image.mask.begin<std::uint8_t>());
    }
    return image;
  } catch (const Error& error) {
    return report_undecodable(error.text().found.empty() ? error.text().what : error.text().found);
  }
}

Findings OldTiles::findings() const {
  const std::lock_guard lock(mutex_);
  Findings findings = undecodable_;
  const Findings read = tiles_.findings();
  std::set<std::string> named;  // a tile may have been read more than once
  for (Finding finding : read.items()) {
    if (!named.insert(finding.where).second) continue;
    finding.fix = "get the package again from its source; `nadir cache verify --depth full` lists all damage";
    findings.add(std::move(finding));
  }
  return findings;
}

int floor_tile(int pixel) { return pixel >= 0 ? pixel / kTileSize : -((kTileSize - 1 - pixel) / kTileSize); }

UpdateLayers::Origin UpdateLayers::origin_of(const Sidecar& sidecar) {
  return {sidecar.source, sidecar.captured_at.unix_s, sidecar.gsd_mm, sidecar.ce90_mm, sidecar.trust};
}

UpdateLayers::UpdateLayers(std::vector<ImageryInput> rasters, const OldTiles& old, MosaicOrder order)
    : old_(old), finest_(old.sidecars().empty() ? 0 : old.sidecars().back().key.z), inputs_(std::move(rasters)) {
  for (const Sidecar& sidecar : old.sidecars()) origins_.emplace(origin_of(sidecar), 0);
  for (const auto& [origin, unused] : origins_) {
    const auto& [source, captured_at, gsd_mm, ce90_mm, trust] = origin;
    ImageryInput input;
    input.facts = {{captured_at}, static_cast<double>(gsd_mm) / 1000, static_cast<double>(ce90_mm) / 1000, source};
    input.trust = trust;
    inputs_.push_back(std::move(input));
  }
  inputs_ = in_order(std::move(inputs_), order);
  for (std::size_t i = 0; i < inputs_.size(); ++i) {
    if (is_new(i) || layers_.empty() || !layers_.back().old) layers_.push_back({i, !is_new(i)});
    layer_of_.push_back(layers_.size() - 1);
    if (is_new(i)) continue;
    const ImageryFacts& facts = inputs_[i].facts;
    origins_[{facts.provider, facts.captured_at.unix_s, std::llround(facts.gsd_m * 1000),
              std::llround(facts.ce90_m * 1000), inputs_[i].trust}] = i;
  }
}

std::vector<LayerReader> UpdateLayers::readers() const {
  std::vector<LayerReader> readers;
  for (std::size_t layer = 0; layer < layers_.size(); ++layer) {
    if (layers_[layer].old) {
      readers.emplace_back([this, layer](int zoom, const cv::Rect& pixels) { return read_old(layer, zoom, pixels); });
      continue;
    }
    const ImageryInput& input = inputs_[layers_[layer].first];
    const auto source = std::make_shared<RasterSource>(input.path, input.stretch);
    readers.emplace_back([source](int zoom, const cv::Rect& pixels) { return source->read(zoom, pixels); });
  }
  return readers;
}

MaskedImage UpdateLayers::read_old(std::size_t layer, int zoom, const cv::Rect& pixels) const {
  MaskedImage image{cv::Mat::zeros(pixels.size(), CV_8UC3), cv::Mat::zeros(pixels.size(), CV_8UC1)};
  for (int y = std::max(0, floor_tile(pixels.y)); y * kTileSize < pixels.br().y; ++y) {
    for (int x = std::max(0, floor_tile(pixels.x)); x * kTileSize < pixels.br().x; ++x) {
      const TileKey key{static_cast<std::uint8_t>(zoom), static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y)};
      const Sidecar* sidecar = old_.sidecar(key);
      if (sidecar == nullptr || layer_of_[origins_.at(origin_of(*sidecar))] != layer) continue;
      const MaskedImage tile = old_.image(key);
      const cv::Point corner(x * kTileSize, y * kTileSize);
      const cv::Rect part = pixels & cv::Rect(corner, cv::Size(kTileSize, kTileSize));
      tile.bgr(part - corner).copyTo(image.bgr(part - pixels.tl()));
      tile.mask(part - corner).copyTo(image.mask(part - pixels.tl()));
    }
  }
  return image;
}

InputShares UpdateLayers::by_input(const TileKey& finest, const InputShares& by_layer) const {
  InputShares shares;
  for (const auto& [layer, pixels] : by_layer) {
    if (!layers_[layer].old) {
      shares[layers_[layer].first] += pixels;
    } else if (const Sidecar* sidecar = old_.sidecar(finest); sidecar != nullptr) {
      shares[origins_.at(origin_of(*sidecar))] += pixels;
    }
  }
  return shares;
}

InputShares UpdateLayers::of_old(const TileKey& key) const {
  const Sidecar* sidecar = old_.sidecar(key);
  if (sidecar == nullptr) return {};
  const auto valid = static_cast<std::uint64_t>(kTilePixels * sidecar->valid_ppm / kWholeTile_ppm);
  return {{origins_.at(origin_of(*sidecar)), std::max<std::uint64_t>(1, valid) << (2 * (finest_ - key.z))}};
}

bool UpdateLayers::may_touch(const TileKey& key) const {
  const double tile_m = mercator_pixel_m(key.z) * kTileSize;
  const double west = key.x * tile_m - kMercatorHalfWorld_m, north = kMercatorHalfWorld_m - key.y * tile_m;
  return std::any_of(inputs_.begin(), inputs_.end(), [&](const ImageryInput& input) {
    if (input.path.empty()) return false;
    double left = std::numeric_limits<double>::max(), bottom = left, right = -left, top = -left;
    for (const MercatorXY& point : input.outline) {
      left = std::min(left, point.x_m), right = std::max(right, point.x_m);
      bottom = std::min(bottom, point.y_m), top = std::max(top, point.y_m);
    }
    // An edge that is curved in this projection may bulge out between the outline's points.
    const double margin_m = mercator_pixel_m(finest_) * kTileSize;
    return left - margin_m < west + tile_m && west < right + margin_m && bottom - margin_m < north &&
           north - tile_m < top + margin_m;
  });
}

template <typename Visit>
void for_each_key(const TileKey& metatile, int zoom, Visit visit) {  // in the order of cut_metatile()
  const int steps = zoom - metatile.z, across = 1 << steps;
  for (int column = 0; column < across; ++column) {
    for (int row = 0; row < across; ++row) {
      visit(TileKey{static_cast<std::uint8_t>(zoom), (metatile.x << steps) + static_cast<std::uint32_t>(column),
                    (metatile.y << steps) + static_cast<std::uint32_t>(row)});
    }
  }
}

// Decodes only the top tile. An overview stays when a tile of the finest zoom below it does.
UpdatedMetatile copy_metatile(const TileKey& key, const UpdateContext& work) {
  UpdatedMetatile result;
  std::set<TileKey> wanted;
  for (int zoom = work.range.zoom; zoom >= key.z; --zoom) {
    for_each_key(key, zoom, [&](const TileKey& tile_key) {
      if (zoom == work.range.zoom ? !work.range.contains(tile_key) : !wanted.contains(tile_key)) return;
      if (work.old.sidecar(tile_key) == nullptr) return;
      wanted.insert(tile_key.parent());
      std::optional<EncodedTile> tile = work.old.copy(tile_key);
      if (!tile) return;  // damaged: OldTiles has the finding
      result.metatile.tiles.push_back(std::move(*tile));
      ++result.counts.copied;
    });
  }
  const bool empty = result.metatile.tiles.empty();
  // A key that no map holds gives the blank image.
  result.metatile.top = {work.old.image(empty ? TileKey{kMaxZoom, 0, 0} : key),
                         empty ? InputShares{} : work.layers.of_old(key)};
  return result;
}

// The old tile when it stays and there is one, else the tile encoded again; counts which of the two it was.
EncodedTile copy_or_encode(const UpdateContext& work, const TileKey& key, const TileCanvas& tile, bool stays,
                           UpdateCounts& counts) {
  if (stays) {
    if (std::optional<EncodedTile> copied = work.old.copy(key)) {
      ++counts.copied;
      return std::move(*copied);
    }
  }
  ++(work.old.sidecar(key) != nullptr ? counts.reencoded : counts.added);
  return work.encoder.encode(key, tile);
}

UpdatedMetatile update_metatile(const TileKey& key, const UpdateContext& work, std::span<const LayerReader> readers) {
  if (!work.layers.may_touch(key)) return copy_metatile(key, work);
  const int finest = work.range.zoom;
  MetatileCanvas canvas = compose_metatile(key, work.range, readers, work.feather_px);
  std::set<TileKey> changed;
  const TileKey first{static_cast<std::uint8_t>(finest), key.x << (finest - key.z), key.y << (finest - key.z)};
  for_each_key(key, finest, [&](const TileKey& tile_key) {
    InputShares& used = canvas.used.at(static_cast<int>(tile_key.x - first.x), static_cast<int>(tile_key.y - first.y));
    used = work.layers.by_input(tile_key, used);
    const bool touched =
        std::any_of(used.begin(), used.end(), [&](const auto& share) { return work.layers.is_new(share.first); });
    if (touched) changed.insert(tile_key);
  });
  if (changed.empty()) return copy_metatile(key, work);

  UpdatedMetatile result;
  result.changed = true;
  result.metatile.top =
      cut_metatile(key, finest, std::move(canvas), [&](const TileKey& tile_key, const TileCanvas& tile) {
        const bool stays = !changed.contains(tile_key);
        if (!stays) changed.insert(tile_key.parent());
        result.metatile.tiles.push_back(copy_or_encode(work, tile_key, tile, stays, result.counts));
      });
  return result;
}

}  // namespace

UpdateCounts& UpdateCounts::operator+=(const UpdateCounts& other) {
  copied += other.copied, reencoded += other.reencoded, added += other.added, dropped += other.dropped;
  return *this;
}

UpdatedTileSet update_tile_set(const Mission& mission, OldTileSet old_tiles, std::vector<ImageryInput> rasters,
                               const TileRange& range, const TileSetOptions& options, const std::filesystem::path& file,
                               Progress& progress) {
  const OldTiles old(old_tiles.file, std::move(old_tiles.sidecars), mission);
  const UpdateLayers layers(std::move(rasters), old, options.mosaic.order);
  const SingleOpenCvThread one_thread;
  const TileEncoder encoder(mission, layers.inputs(), options.encoding);
  const UpdateContext work{old, layers, range, encoder, feather_pixels(mission, options.mosaic)};
  const std::vector<TileKey> tops = metatiles_of(mission, range);
  TileSetWriter writer(options.container, file, mission, range, options.encoding.format);
  UpdateCounts counts;
  std::set<TileKey> changed;  // overviews above the metatiles
  OverviewAssembler overviews(tops, mission.zoom.min, [&](const TileKey& key, const TileCanvas& overview) {
    const bool stays = !changed.contains(key);
    if (!stays) changed.insert(key.parent());
    writer.add(copy_or_encode(work, key, overview, stays, counts));
  });

  progress.begin("updating tiles", tops.empty() ? 0 : count_tiles(tops, range, range.zoom).back().tiles, "tiles");
  work_in_order<UpdatedMetatile>(
      tops.size(), options.threads,
      [&]() -> std::function<UpdatedMetatile(std::size_t)> {
        return [&, readers = layers.readers()](std::size_t item) { return update_metatile(tops[item], work, readers); };
      },
      [&](std::size_t item, UpdatedMetatile updated) {
        std::uint64_t finest = 0;
        for (EncodedTile& tile : updated.metatile.tiles) {
          finest += tile.sidecar.key.z == range.zoom ? 1U : 0U;
          writer.add(std::move(tile));
        }
        counts += updated.counts;
        if (updated.changed) changed.insert(tops[item].parent());
        overviews.add(tops[item], updated.metatile.top);
        progress.advance(finest);
        return !writer.over_budget();
      });
  progress.end();
  counts.dropped = old.sidecars().size() - counts.copied - counts.reencoded;
  return {writer.finish(range, options.encoding.format), counts, old.findings()};
}

}  // namespace nadir
