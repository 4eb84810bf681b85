// Map tiles for tests of pages: patches of colour that continue across tile edges. Generated on request.
#pragma once

#include "imagery/tile_source.hpp"

namespace nadir::test {

class PaintedTiles final : public TileSource {
 public:
  ZoomRange zooms() const override { return {14, 18}; }
  std::optional<Bytes> read(const TileKey& key) const override;
};

}  // namespace nadir::test
