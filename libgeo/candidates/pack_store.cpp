#include "candidates/pack_store.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace fs = std::filesystem;

PackStore::PackStore(fs::path folder) : folder_(std::move(folder)) {
  fs::create_directories(folder_);
  sync_to_disk(folder_.parent_path());
}

fs::path PackStore::path_of(const Sha256& pack) const {
  const std::string hex = pack.hex();
  return folder_ / hex.substr(0, 2) / hex;
}

void PackStore::adopt(const fs::path& file, const Sha256& pack) {
  const fs::path target = path_of(pack);
  if (fs::create_directory(target.parent_path())) sync_to_disk(folder_);
  std::error_code code;
  fs::create_hard_link(file, target, code);
  if (code == std::errc::file_exists && sha256_file(target) != pack) {
    const fs::path beside = target.string() + ".new";
    fs::remove(beside);
    code.clear();
    fs::create_hard_link(file, beside, code);
    if (!code) fs::rename(beside, target, code);
  }
  if (code && !fs::exists(target)) {
    throw Error({.what = "a pack cannot be put into place", .where = target, .found = code.message()});
  }
  sync_to_disk(target);  // a part that a killed process wrote may not be there yet
  sync_to_disk(target.parent_path());
}

Bytes PackStore::read(const BlobPlace& place, const Sha256& sha256) const {
  const fs::path path = path_of(place.pack);
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) {
    throw Error({.what = "a pack is missing",
                 .where = path,
                 .found = system_error_text(errno),
                 .fix = "restore the folder from a copy; the catalogue and the packs belong together"});
  }
  Bytes bytes(place.bytes);
  std::size_t have = 0;
  int failed = 0;
  while (have < bytes.size()) {
    const ssize_t got = ::pread(fd, bytes.data() + have, bytes.size() - have, static_cast<off_t>(place.start + have));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) failed = errno;
    if (got <= 0) break;
    have += static_cast<std::size_t>(got);
  }
  ::close(fd);
  if (failed != 0) {
    throw Error({.what = "a pack cannot be read",
                 .where = path,
                 .found = system_error_text(failed),
                 .fix = "check the disk; restore the folder from a copy"});
  }
  if (have != bytes.size() || nadir::sha256(bytes) != sha256) {
    throw PackDamaged({.what = "a pack is damaged",
                       .where = path,
                       .expected = "a tile with SHA-256 " + sha256.hex(),
                       .fix = "check the disk; restore the folder from a copy"});
  }
  return bytes;
}

void PackStore::remove(const Sha256& pack) {
  std::error_code ignored;
  fs::remove(path_of(pack), ignored);
}

std::vector<Sha256> PackStore::packs() const {
  std::vector<Sha256> packs;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder_)) {
    if (const auto pack = Sha256::from_hex(entry.path().filename().string()); pack && entry.is_regular_file()) {
      packs.push_back(*pack);
    }
  }
  return packs;
}

std::uint64_t PackStore::free_bytes() const { return fs::space(folder_).available; }

}  // namespace nadir
