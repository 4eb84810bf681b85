// Makes the overviews above the metatiles. Pictures come in the order of a space-filling curve, so that parents are
// complete soon: a few pictures per zoom wait in memory, however large the area is.
#pragma once

#include <functional>
#include <map>
#include <vector>

#include "package_build/metatile.hpp"

namespace nadir {

class OverviewAssembler {
 public:
  // Gets every overview that shows ground.
  using Take = std::function<void(const TileKey& key, const TileCanvas& overview)>;

  // tops: every metatile that will be added. Parents down to min_zoom are made.
  OverviewAssembler(const std::vector<TileKey>& tops, int min_zoom, Take take);

  void add(const TileKey& key, const TileCanvas& tile);

 private:
  struct Parent {
    Picture picture;  // twice kTileSize
    InputShares used;
    int missing = 0;
  };
  int min_zoom_;
  Take take_;
  std::map<TileKey, int> children_;  // how many children each parent gets
  std::map<TileKey, Parent> parents_;
};

}  // namespace nadir
