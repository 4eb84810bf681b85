// Where the service keeps the bytes of tiles: whole packs, named by their SHA-256, in folders by its first two digits.
// What has a name is complete, has that digest and is on the disk; nothing is ever changed, only removed. Which tile
// lies where in which pack is the catalogue's to know.
//
// One file for hundreds of tiles, because a file that must survive a power cut costs milliseconds, whatever its size.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/bytes.hpp"
#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/time.hpp"
#include "candidates/catalogue_rows.hpp"

namespace nadir {

// Makes the folder, with those above it, where it is missing; true: it was. Throws OutOfSpace, Error.
bool make_folder(const std::filesystem::path& folder);

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

// Packs being received: DIR/UPLOAD/SHA256.LENGTH, as long as what has arrived of them. Every part is on the disk before
// it is acknowledged. Such a file is always a prefix of what was sent: parts are whole and checked before the first of
// their bytes is written, so that a killed process leaves a shorter prefix and never wrong bytes.
//
// The names are made of an upload's name and a digest, both checked by their forms: no caller's text becomes a path.
struct IncomingPack {
  Sha256 sha256;
  std::uint64_t length = 0;  // of the whole pack
  std::uint64_t offset = 0;  // what is there
  std::int64_t grown_s = 0;  // when its last part came, by the service's clock: the file's time
  std::filesystem::path path;

  bool whole() const { return offset == length; }
};

class IncomingPacks {
 public:
  explicit IncomingPacks(std::filesystem::path folder);  // makes it where it is missing

  std::vector<IncomingPack> of(const std::string& upload) const;
  std::optional<IncomingPack> find(const std::string& upload, const Sha256& sha256) const;
  std::vector<std::string> uploads() const;

  // Opens a pack of which nothing is there.
  IncomingPack begin(const std::string& upload, const Sha256& sha256, std::uint64_t length);
  // At pack.offset, which must still be the file's size. Throws OutOfSpace, Error.
  void append(IncomingPack& pack, ByteView part, UtcTime now);

  void remove(const IncomingPack& pack);
  void remove_all_of(const std::string& upload);

 private:
  std::filesystem::path folder_;
};

}  // namespace nadir
