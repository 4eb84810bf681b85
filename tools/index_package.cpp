#include "index_package.hpp"

#include <fcntl.h>
#include <stdio.h>

#include <cerrno>

#include "base/error.hpp"
#include "base/files.hpp"
#include "ground/package_parts.hpp"
#include "package/judge.hpp"
#include "package/sign_package.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

bool is_of_the_index(const fs::path& relative) {
  const std::string name = relative.generic_string();
  return name == kPlaceIndexFile || name == kPlaceTableFile || name == kManifestFile || name == kSignatureFile;
}

// Files of a package are never written to, so two packages may share them.
void link_or_copy(const fs::path& from, const fs::path& to) {
  std::error_code error;
  fs::create_hard_link(from, to, error);
  if (error) fs::copy_file(from, to);
}

void carry_over(const fs::path& package, const Manifest& manifest, const fs::path& target) {
  for (const Artifact& artifact : manifest.artifacts) {
    if (artifact.role == kRolePlaceIndex || artifact.role == kRolePlaceTable) continue;
    fs::create_directories((target / artifact.path).parent_path());
    link_or_copy(package / artifact.path, target / artifact.path);
  }
  for (const auto& entry : fs::recursive_directory_iterator(package)) {  // roots of trust, which are no artifacts
    const fs::path relative = entry.path().lexically_relative(package);
    if (!entry.is_regular_file() || is_of_the_index(relative) || fs::exists(target / relative)) continue;
    fs::create_directories((target / relative).parent_path());
    link_or_copy(entry.path(), target / relative);
  }
}

void exchange(const fs::path& made, const fs::path& package) {
  if (::renameat2(AT_FDCWD, made.c_str(), AT_FDCWD, package.c_str(), RENAME_EXCHANGE) == 0) return;
  const std::string why = system_error_text(errno);
  fs::remove_all(made);
  throw Error({.what = "cannot put the indexed package into the old one's place",
               .where = package,
               .expected = "a file system that exchanges two names in one step (ext4, xfs, btrfs, tmpfs)",
               .found = why,
               .fix = "index the package on a local disk, then copy it"});
}

}  // namespace

void require_key_when_signed(const fs::path& package, bool have_key) {
  if (have_key || !fs::exists(fs::symlink_status(package / kSignatureFile))) return;
  throw UsageError({.what = "this package is signed, and an index changes what was signed",
                    .where = package,
                    .expected = "--key KEY.pem, so that the package is signed anew",
                    .found = "no key",
                    .fix = "give the signer's key; other signers then add theirs with `nadir cache sign`"});
}

IndexedPackage put_index(const fs::path& package, const Manifest& manifest, const Mission& mission,
                         const PlaceIndex& index, const PrivateKey* key) {
  require_key_when_signed(package, key != nullptr);
  fs::path whole = fs::weakly_canonical(package);
  if (!whole.has_filename()) whole = whole.parent_path();
  const fs::path made = whole.parent_path() / ("." + whole.filename().string() + ".indexed");
  fs::remove_all(made);  // what a process left that was killed after commit() and before the exchange
  StagingDirectory staging(made);
  const fs::path& folder = staging.path();
  carry_over(whole, manifest, folder);
  Manifest with = manifest;
  std::erase_if(with.artifacts, [](const Artifact& artifact) {
    return artifact.role == kRolePlaceIndex || artifact.role == kRolePlaceTable;
  });
  for (Artifact& artifact : write_place_index(folder, index)) with.artifacts.push_back(std::move(artifact));
  IndexedPackage result;
  for (const Artifact& artifact : with.artifacts) result.bytes += artifact.size;
  result.index_bytes = with.artifacts[with.artifacts.size() - 2].size + with.artifacts.back().size;
  result.findings = judge_budget(mission, result.bytes);
  if (result.findings.refuses()) return result;
  write_manifest(folder, with);
  if (key != nullptr) sign_package(folder, *key);
  result.is_signed = key != nullptr;
  staging.commit();
  exchange(made, whole);
  fs::remove_all(made);
  return result;
}

}  // namespace nadir
