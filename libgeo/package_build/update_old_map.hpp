// The tiles of the package that is updated: as bytes to copy, and as pictures that new imagery is laid upon.
//
// Every tile is hashed when it is read and compared with the digest that was verified; one that differs or does not
// decode is as if it were not there, and a finding. May be used by several threads.
#pragma once

#include <filesystem>
#include <mutex>
#include <optional>
#include <vector>

#include "package_build/metatile.hpp"
#include "package/open_package.hpp"

namespace nadir {

class OldMap {
 public:
  // tiles: an MBTiles file or a COG. sidecars: verified, in the order of TileKey. mission: the new one, which names the
  // sectors anew.
  OldMap(const std::filesystem::path& tiles, std::vector<Sidecar> sidecars, const Mission& mission);

  const std::vector<Sidecar>& sidecars() const { return tiles_.sidecars(); }
  const Sidecar* sidecar(const TileKey& key) const { return tiles_.sidecar(key); }

  // The tile as it was, bytes and sidecar; only its sector is that of the new mission.
  std::optional<EncodedTile> copy(const TileKey& key) const;

  // The tile's pixels; the mask is 0 throughout where there is no tile.
  Picture picture(const TileKey& key) const;

  // artifact.hash, sqlite.corrupt, tile.undecodable of what has been read so far.
  Findings findings() const;

 private:
  std::optional<Picture> decode(const TileKey& key, ByteView bytes) const;

  CheckedTiles tiles_;
  const Mission& mission_;
  LocalFrame frame_;
  mutable std::mutex mutex_;
  mutable Findings undecodable_;
};

}  // namespace nadir
