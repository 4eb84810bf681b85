// Packs on their way: DIR/UPLOAD/SHA256.LENGTH, as long as what has come of them. Every part is on the disk before its
// sender hears so. What stands in such a file is always a beginning of what was sent: parts are whole and checked
// before the first of their bytes is written, so that a killed process leaves fewer of them and never other ones.
//
// The names are made of an upload's name and a digest, both checked by their forms: no caller's text becomes a path.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/bytes.hpp"
#include "base/digest.hpp"
#include "base/time.hpp"

namespace nadir {

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
