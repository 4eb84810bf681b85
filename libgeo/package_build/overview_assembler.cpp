#include "package_build/overview_assembler.hpp"

#include <opencv2/core.hpp>
#include <set>

namespace nadir {

OverviewAssembler::OverviewAssembler(const std::vector<TileKey>& tops, int min_zoom, Take take)
    : min_zoom_(min_zoom), take_(std::move(take)) {
  std::set<TileKey> level(tops.begin(), tops.end());
  while (!level.empty() && level.begin()->z > min_zoom) {
    std::set<TileKey> parents;
    for (const TileKey& key : level) {
      ++children_[key.parent()];
      parents.insert(key.parent());
    }
    level = std::move(parents);
  }
}

void OverviewAssembler::add(const TileKey& key, const TileCanvas& tile) {
  if (key.z <= min_zoom_) return;
  const TileKey parent_key = key.parent();
  Parent& parent = parents_[parent_key];
  if (parent.picture.bgr.empty()) {
    parent.picture = {cv::Mat::zeros(2 * kTileSize, 2 * kTileSize, CV_8UC3),
                      cv::Mat::zeros(2 * kTileSize, 2 * kTileSize, CV_8UC1)};
    parent.missing = children_.at(parent_key);
  }
  const cv::Rect place(static_cast<int>(key.x % 2) * kTileSize, static_cast<int>(key.y % 2) * kTileSize, kTileSize,
                       kTileSize);
  tile.picture.bgr.copyTo(parent.picture.bgr(place));
  tile.picture.mask.copyTo(parent.picture.mask(place));
  for (const auto& [input, pixels] : tile.used) parent.used[input] += pixels;
  if (--parent.missing > 0) return;
  const TileCanvas whole{halved(parent.picture), parent.used};
  parents_.erase(parent_key);
  if (cv::countNonZero(whole.picture.mask) > 0) take_(parent_key, whole);
  add(parent_key, whole);
}

}  // namespace nadir
