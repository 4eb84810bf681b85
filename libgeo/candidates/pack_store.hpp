// Where the service keeps the bytes of tiles: whole packs, named by their SHA-256, in folders by its first two digits.
// What has a name is complete, has that digest and is on the disk; nothing is ever changed, only removed. Which tile
// lies where in which pack is the catalogue's to know.
//
// One file for hundreds of tiles, because a file that must survive a power cut costs milliseconds, whatever its size.
#pragma once

#include <filesystem>
#include <vector>

#include "base/bytes.hpp"
#include "base/error.hpp"
#include "base/digest.hpp"
#include "candidates/catalogue_rows.hpp"

namespace nadir {

// What lies there is not what was kept: it does not get better, but the tile can be sent again.
class PackDamaged : public Error {
 public:
  using Error::Error;
};

class PackStore {
 public:
  // Makes the folder where it is missing. Throws Error.
  explicit PackStore(std::filesystem::path folder);

  // Takes over a file that has this digest; the file keeps its own name as well. On the disk when it returns. The same
  // pack twice is no error; one that was damaged since is replaced.
  void adopt(const std::filesystem::path& file, const Sha256& pack);

  // Throws PackDamaged when the bytes do not have this digest, Error when they cannot be read now: a folder that is not
  // there may come back.
  Bytes read(const BlobPlace& place, const Sha256& sha256) const;

  void remove(const Sha256& pack);
  std::vector<Sha256> packs() const;
  std::uint64_t free_bytes() const;

 private:
  std::filesystem::path path_of(const Sha256& pack) const;

  std::filesystem::path folder_;
};

}  // namespace nadir
