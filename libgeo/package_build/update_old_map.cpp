#include "package_build/update_old_map.hpp"

#include <fmt/format.h>

#include <opencv2/core.hpp>
#include <set>

#include "base/error.hpp"
#include "package/mission_check.hpp"
#include "package/tile_image.hpp"

namespace nadir {
namespace {

Picture nothing() {
  return {cv::Mat::zeros(kTileSize, kTileSize, CV_8UC3), cv::Mat::zeros(kTileSize, kTileSize, CV_8UC1)};
}

}  // namespace

OldMap::OldMap(const std::filesystem::path& tiles, std::vector<Sidecar> sidecars, const Mission& mission)
    : tiles_(tiles, std::move(sidecars)), mission_(mission), frame_(mission_frame(mission)) {}

std::optional<EncodedTile> OldMap::copy(const TileKey& key) const {
  const Sidecar* sidecar = tiles_.sidecar(key);
  if (sidecar == nullptr) return std::nullopt;
  std::optional<Bytes> bytes = tiles_.read(key);
  if (!bytes) return std::nullopt;
  EncodedTile tile{*sidecar, std::move(*bytes)};
  const Sector* sector = governing_sector(mission_, frame_, key);
  tile.sidecar.sector = sector == nullptr ? std::string() : sector->id;
  return tile;
}

Picture OldMap::picture(const TileKey& key) const {
  const std::optional<Bytes> bytes = tiles_.read(key);
  if (!bytes) return nothing();
  return decode(key, *bytes).value_or(nothing());
}

std::optional<Picture> OldMap::decode(const TileKey& key, ByteView bytes) const {
  const auto complain = [&](std::string found) {
    const std::lock_guard lock(mutex_);
    undecodable_.add({.code = "tile.undecodable",
                      .where = "tile " + to_text(key),
                      .expected = fmt::format("a picture of {0} x {0} pixels", kTileSize),
                      .found = std::move(found)});
    return std::nullopt;
  };
  try {
    DecodedImage decoded = decode_image(bytes, Colour::bgr, "tile " + to_text(key));
    if (decoded.image.size() != cv::Size(kTileSize, kTileSize)) {
      return complain(fmt::format("{} x {}", decoded.image.cols, decoded.image.rows));
    }
    Picture picture{decoded.image, cv::Mat(kTileSize, kTileSize, CV_8UC1, cv::Scalar(255))};
    if (!decoded.alpha.empty()) picture.mask = decoded.alpha >= 128;
    if (const auto png = tiles_.read_mask(key)) {
      const std::optional<Bytes> mask = decode_tile_mask(*png);
      if (!mask) return complain("a mask that does not decode");
      std::copy(mask->begin(), mask->end(), picture.mask.begin<std::uint8_t>());
    }
    return picture;
  } catch (const Error& error) {
    return complain(error.text().found.empty() ? error.text().what : error.text().found);
  }
}

Findings OldMap::findings() const {
  const std::lock_guard lock(mutex_);
  Findings findings = undecodable_;
  const Findings read = tiles_.findings();
  std::set<std::string> named;  // a tile may have been read more than once
  for (Finding finding : read.items()) {
    if (!named.insert(finding.where).second) continue;
    finding.fix = "get the package again from its makers; `nadir cache verify --depth full` names everything";
    findings.add(std::move(finding));
  }
  return findings;
}

}  // namespace nadir
