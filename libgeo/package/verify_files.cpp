#include <fmt/format.h>

#include <fstream>
#include <map>

#include "base/error.hpp"
#include "package/root_folder.hpp"
#include "package/verify_parts.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kMaxUnexpected = 50;
constexpr std::size_t kMaxEntries = 10'000;
constexpr std::size_t kBlock = 1 << 20;

class FileVerifier {
 public:
  FileVerifier(const fs::path& package, const Manifest& manifest, VerifyDepth depth, Progress& progress)
      : package_(package), manifest_(manifest), depth_(depth), progress_(progress) {}

  FileCheck run() {
    walk();
    std::uint64_t to_hash = 0;
    for (const Artifact& artifact : manifest_.artifacts) to_hash += hashes(artifact) ? artifact.size : 0;
    progress_.begin("hashing", to_hash / kBlock + 1, "MiB");
    for (const Artifact& artifact : manifest_.artifacts) verify(artifact);
    progress_.end();
    return std::move(check_);
  }

 private:
  bool hashes(const Artifact& artifact) const {
    return depth_ == VerifyDepth::full || (artifact.role != kRoleImagery && artifact.role != kRoleTerrain);
  }

  // Whatever lies in the folder must be named in the manifest, and be a plain file.
  void walk() {
    std::set<std::string> named{std::string(kManifestFile), std::string(kSignatureFile)};
    for (const Artifact& artifact : manifest_.artifacts) named.insert(artifact.path);
    std::size_t entries = 0;
    for (fs::recursive_directory_iterator at(package_), end; at != end; ++at) {
      const std::string path = at->path().lexically_relative(package_).generic_string();
      const fs::file_status status = at->symlink_status();
      if (fs::is_directory(status)) continue;
      if (++entries > kMaxEntries) return unexpected(path, "more than 10000 files");
      if (!fs::is_regular_file(status)) {
        unexpected(path, fs::is_symlink(status) ? "a symbolic link" : "something that is no regular file");
      } else if (named.contains(path)) {
        present_.insert(path);
      } else if (!is_root_file_name(path)) {  // roots are judged by the walk over them
        unexpected(path, "a file");
      }
    }
  }

  void unexpected(const std::string& path, std::string found) {
    if (++unexpected_ > kMaxUnexpected) return;
    check_.findings.add({.code = "artifact.unexpected",
                         .where = path,
                         .expected = "only the files that the manifest names",
                         .found = std::move(found),
                         .fix = "get the package again from its makers"});
  }

  void verify(const Artifact& artifact) {
    const auto complain = [&](const char* code, std::string expected, std::string found) {
      check_.findings.add({.code = code,
                           .where = artifact.path,
                           .expected = std::move(expected),
                           .found = std::move(found),
                           .fix = "get the package again from its makers"});
    };
    if (!present_.contains(artifact.path)) return complain("artifact.missing", "a regular file", "none");
    const std::uint64_t size = fs::file_size(package_ / artifact.path);
    if (size != artifact.size) {
      complain("artifact.size", fmt::format("{} bytes", artifact.size), fmt::format("{} bytes", size));
      if (artifact.role != kRoleImagery) return;
    }
    if (hashes(artifact) && size == artifact.size) {
      const Sha256 digest = hash(artifact);
      if (digest != artifact.sha256) {
        complain("artifact.hash", artifact.sha256.hex(), digest.hex());
        // The imagery is looked into all the same: its tiles tell what was changed.
        if (artifact.role != kRoleImagery) return;
      }
    }
    check_.sound.insert(artifact.path);
  }

  // Never more than the size that was signed.
  Sha256 hash(const Artifact& artifact) {
    std::ifstream file(package_ / artifact.path, std::ios::binary);
    if (!file) throw Error({.what = "cannot open a file of the package", .where = package_ / artifact.path});
    Sha256Stream stream;
    Bytes block(kBlock);
    for (std::uint64_t left = artifact.size; left > 0;) {
      const std::size_t want = static_cast<std::size_t>(std::min<std::uint64_t>(left, block.size()));
      file.read(reinterpret_cast<char*>(block.data()), static_cast<std::streamsize>(want));
      const auto got = static_cast<std::size_t>(file.gcount());
      if (file.bad()) throw Error({.what = "cannot read a file of the package", .where = package_ / artifact.path});
      stream.update(ByteView(block).first(got));
      if (got < want) break;
      left -= got;
      progress_.advance();
    }
    return stream.finish();
  }

  const fs::path& package_;
  const Manifest& manifest_;
  VerifyDepth depth_;
  Progress& progress_;
  FileCheck check_;
  std::set<std::string> present_;
  std::size_t unexpected_ = 0;
};

}  // namespace

FileCheck verify_files(const fs::path& package, const Manifest& manifest, VerifyDepth depth, Progress& progress) {
  return FileVerifier(package, manifest, depth, progress).run();
}

}  // namespace nadir
