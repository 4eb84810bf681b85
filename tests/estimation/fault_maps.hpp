// Maps that are wrong, made of the right one's tiles.
#pragma once

#include <functional>
#include <map>
#include <opencv2/core/mat.hpp>

#include "imagery/tile_source.hpp"

namespace nadir::test {

// What another map shows, with every tile changed.
class ChangedTiles final : public TileSource {
 public:
  // where: the tile of the right map that stands for the one asked for. change: what becomes of its picture (BGR).
  ChangedTiles(const TileSource& right, std::function<TileKey(const TileKey&)> where,
               std::function<void(cv::Mat&, const TileKey&)> change)
      : right_(right), where_(std::move(where)), change_(std::move(change)) {}

  ZoomRange zooms() const override { return right_.zooms(); }
  std::optional<Bytes> read(const TileKey& key) const override;

 private:
  const TileSource& right_;
  std::function<TileKey(const TileKey&)> where_;
  std::function<void(cv::Mat&, const TileKey&)> change_;
  mutable std::map<TileKey, std::optional<Bytes>> known_;
};

const TileSource& mirrored_tiles();  // of landscape_tiles(), east is west, about the tile of the origin
const TileSource& outdated_tiles();  // nearly half of each tile has been built over since
const TileSource& rebuilt_tiles();   // hardly anything is as it was

}  // namespace nadir::test
