#include "candidates/pack_store.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/number_text.hpp"

namespace nadir {

namespace fs = std::filesystem;

namespace {

[[noreturn]] void disk_failed(const char* what, const fs::path& where, std::error_code code) {
  const bool full = code == std::errc::no_space_on_device || code.value() == EDQUOT;
  ErrorText text{.what = what,
                 .where = where,
                 .found = code.message(),
                 .fix = full ? "make room on this disk" : "check the disk, and the owner of this folder"};
  if (full) throw OutOfSpace(std::move(text));
  throw Error(std::move(text));
}

}  // namespace

bool make_folder(const fs::path& folder) {
  std::error_code code;
  const bool made = fs::create_directories(folder, code);
  if (code) disk_failed("cannot create a folder of the service", folder, code);
  return made;
}

PackStore::PackStore(fs::path folder) : folder_(std::move(folder)) {
  make_folder(folder_);
  sync_to_disk(folder_.parent_path());
}

fs::path PackStore::path_of(const Sha256& pack) const {
  const std::string hex = pack.hex();
  return folder_ / hex.substr(0, 2) / hex;
}

void PackStore::adopt(const fs::path& file, const Sha256& pack) {
  const fs::path target = path_of(pack);
  if (make_folder(target.parent_path())) sync_to_disk(folder_);
  std::error_code code;
  fs::create_hard_link(file, target, code);
  if (code == std::errc::file_exists && sha256_file(target) != pack) {
    const fs::path beside = target.string() + ".new";
    fs::remove(beside);
    code.clear();
    fs::create_hard_link(file, beside, code);
    if (!code) fs::rename(beside, target, code);
  }
  if (code && !fs::exists(target)) disk_failed("cannot move a pack into place", target, code);
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
                       .found = have == bytes.size() ? "other bytes" : "the end of the file",
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

std::uint64_t PackStore::free_bytes() const {
  std::error_code code;
  const fs::space_info space = fs::space(folder_, code);
  if (code) disk_failed("cannot tell how much room the disk has", folder_, code);
  return space.available;
}

namespace {

// "SHA256.LENGTH"; nullopt for a file that is not ours, or that another call has removed a moment ago.
std::optional<IncomingPack> read_name(const fs::path& path) {
  const std::string name = path.filename().string();
  constexpr std::size_t kDigits = 64;
  if (name.size() < kDigits + 2 || name[kDigits] != '.') return std::nullopt;
  const auto sha256 = Sha256::from_hex(name.substr(0, kDigits));
  const auto length = whole_number<std::uint64_t>(std::string_view(name).substr(kDigits + 1));
  if (!sha256 || !length) return std::nullopt;
  struct stat facts {};
  if (::stat(path.c_str(), &facts) != 0) return std::nullopt;
  return IncomingPack{.sha256 = *sha256,
                      .length = *length,
                      .offset = static_cast<std::uint64_t>(facts.st_size),
                      .grown_s = facts.st_mtim.tv_sec,
                      .path = path};
}

void require_plain_name(const std::string& upload) {
  const bool plain = !upload.empty() && upload.size() <= 64 && std::all_of(upload.begin(), upload.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
  });
  if (!plain)
    throw Error({.what = "this is not the name of an upload",
                 .expected = "1 to 64 letters, digits, '_' and '-'",
                 .found = fmt::format("{} characters", upload.size())});
}

}  // namespace

IncomingPacks::IncomingPacks(fs::path folder) : folder_(std::move(folder)) { make_folder(folder_); }

std::vector<IncomingPack> IncomingPacks::of(const std::string& upload) const {
  require_plain_name(upload);
  std::vector<IncomingPack> packs;
  std::error_code none;
  for (fs::directory_iterator entry(folder_ / upload, none), end; entry != end; entry.increment(none)) {
    if (auto pack = read_name(entry->path())) packs.push_back(std::move(*pack));
  }
  return packs;
}

std::optional<IncomingPack> IncomingPacks::find(const std::string& upload, const Sha256& sha256) const {
  for (IncomingPack& pack : of(upload)) {
    if (pack.sha256 == sha256) return std::move(pack);
  }
  return std::nullopt;
}

std::vector<std::string> IncomingPacks::uploads() const {
  std::vector<std::string> names;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_)) {
    if (entry.is_directory()) names.push_back(entry.path().filename().string());
  }
  return names;
}

IncomingPack IncomingPacks::begin(const std::string& upload, const Sha256& sha256, std::uint64_t length) {
  require_plain_name(upload);
  if (make_folder(folder_ / upload)) sync_to_disk(folder_);
  return {.sha256 = sha256, .length = length, .path = folder_ / upload / fmt::format("{}.{}", sha256.hex(), length)};
}

void IncomingPacks::append(IncomingPack& pack, ByteView part, UtcTime now) {
  {
    AppendFile file(pack.path);
    file.cut(pack.offset);
    try {
      file.append(part);
    } catch (...) {
      // What a full disk has taken of it is a good beginning all the same, but simpler is: nothing of this part.
      file.cut(pack.offset);
      throw;
    }
  }
  // Not the disk's own clock: whether a pack rests is judged by the service's. A time that is lost costs nothing.
  const timespec at{.tv_sec = now.unix_s, .tv_nsec = 0};
  const timespec times[] = {at, at};
  ::utimensat(AT_FDCWD, pack.path.c_str(), times, 0);
  sync_to_disk(pack.path);
  if (pack.offset == 0) sync_to_disk(pack.path.parent_path());
  pack.offset += part.size();
  pack.grown_s = now.unix_s;
}

void IncomingPacks::remove(const IncomingPack& pack) {
  std::error_code ignored;
  fs::remove(pack.path, ignored);
}

void IncomingPacks::remove_all_of(const std::string& upload) {
  require_plain_name(upload);
  std::error_code ignored;
  fs::remove_all(folder_ / upload, ignored);
}

}  // namespace nadir
