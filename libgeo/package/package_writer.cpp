#include "package/package_writer.hpp"

#include <fcntl.h>
#include <stdio.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

#include "base/error.hpp"
#include "base/files.hpp"
#include "package/mission_check.hpp"
#include "trust/signed_document.hpp"

namespace nadir {
namespace fs = std::filesystem;
void write_manifest(const std::filesystem::path& package, const Manifest& manifest) {
  const std::string bytes = manifest_json(manifest);
  const ManifestReading check = parse_manifest(as_bytes(bytes));
  if (!check.manifest) {
    const Finding& first = check.findings.items().front();
    throw Error({.what = "every reader would reject this manifest",
                 .where = first.where,
                 .expected = first.expected,
                 .found = first.found,
                 .fix = "correct the mission file, and build the package again"});
  }
  write_file_atomic(package / kManifestFile, bytes);
}

void sign_package(const std::filesystem::path& package, const PrivateKey& key) {
  const Bytes manifest = read_file(package / kManifestFile, kMaxManifestSize);
  const Envelope envelope{std::string(kManifestPayloadType), {sign_payload(key, kManifestPayloadType, manifest)}};
  write_file_atomic(package / kSignatureFile, envelope_json(envelope));
}

std::size_t add_package_signature(const fs::path& package, const PrivateKey& key) {
  const Bytes manifest = read_file(package / kManifestFile, kMaxManifestSize);
  const fs::path file = package / kSignatureFile;
  Envelope envelope{std::string(kManifestPayloadType), {}};
  if (fs::exists(fs::symlink_status(file))) {
    try {
      envelope = parse_envelope(read_text_file(file, kMaxEnvelopeSize), file.string());
    } catch (const Error& error) {
      throw UsageError({.what = "cannot add to the existing signatures",
                        .where = file,
                        .expected = error.text().expected,
                        .found = error.text().found.empty() ? error.text().what : error.text().found,
                        .fix = "sign with --only, which drops the older signatures"});
    }
  }
  envelope.payload_type = kManifestPayloadType;
  put_signature(envelope.signatures, sign_payload(key, kManifestPayloadType, manifest));
  write_file_atomic(file, envelope_json(envelope));
  return envelope.signatures.size();
}

namespace {

// Files of a package are never written to, so two packages may share them.
void link_or_copy(const fs::path& from, const fs::path& to) {
  std::error_code error;
  fs::create_directories(to.parent_path());
  fs::create_hard_link(from, to, error);
  if (error) fs::copy_file(from, to);
}

// Everything that is not written again: the artifacts that stay, and roots of trust, which are not artifacts.
void copy_unchanged(const fs::path& package, const Manifest& manifest, const Manifest& kept, const fs::path& target) {
  std::set<std::string> left_out{std::string(kManifestFile), std::string(kSignatureFile)};
  for (const Artifact& artifact : manifest.artifacts) left_out.insert(artifact.path);
  for (const Artifact& artifact : kept.artifacts) {
    left_out.erase(artifact.path);
    link_or_copy(package / artifact.path, target / artifact.path);
  }
  for (const auto& entry : fs::recursive_directory_iterator(package)) {
    const fs::path relative = entry.path().lexically_relative(package);
    if (!entry.is_regular_file() || left_out.contains(relative.generic_string()) || fs::exists(target / relative)) {
      continue;
    }
    link_or_copy(entry.path(), target / relative);
  }
}

void exchange(const fs::path& made, const fs::path& package) {
  if (::renameat2(AT_FDCWD, made.c_str(), AT_FDCWD, package.c_str(), RENAME_EXCHANGE) != 0) {
    const std::string why = system_error_text(errno);
    fs::remove_all(made);
    throw Error({.what = "cannot replace the package",
                 .where = package,
                 .expected = "a file system that exchanges two names in one step (ext4, xfs, btrfs, tmpfs)",
                 .found = why,
                 .fix = "do this on a local disk, then copy the package"});
  }
  // On the disk before the old one is removed.
  const int folder = ::open(package.parent_path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder < 0) return;
  ::fsync(folder);
  ::close(folder);
}

}  // namespace

void require_key_when_signed(const fs::path& package, bool have_key) {
  if (have_key || !fs::exists(fs::symlink_status(package / kSignatureFile))) return;
  throw UsageError({.what = "the package is signed, and adding artifacts invalidates the signature",
                    .where = package,
                    .expected = "--key KEY.pem to sign the package again",
                    .found = "no key",
                    .fix = "give the signer's key; other signers then add their signatures with `nadir cache sign`"});
}

Manifest load_package_manifest(const fs::path& package) {
  if (!fs::is_regular_file(fs::symlink_status(package / kManifestFile))) {
    throw UsageError({.what = "not a mission package",
                      .where = package,
                      .expected = "a folder with manifest.json",
                      .found = "none",
                      .fix = "give the folder that `nadir cache build --out` created"});
  }
  ManifestReading reading = parse_manifest(read_file(package / kManifestFile, kMaxManifestSize));
  if (reading.manifest) return *std::move(reading.manifest);
  const Finding& first = reading.findings.items().front();
  throw Error({.what = "cannot read the manifest",
               .where = (package / kManifestFile).string() + ": " + first.where,
               .expected = first.expected,
               .found = first.found});
}

AmendedPackage amend_package(const fs::path& package, const Manifest& manifest, const Mission& mission,
                             const Amendment& amendment, const PrivateKey* key, Progress& progress) {
  require_key_when_signed(package, key != nullptr);
  fs::path whole = fs::weakly_canonical(package);
  if (!whole.has_filename()) whole = whole.parent_path();
  const fs::path made = whole.parent_path() / ("." + whole.filename().string() + ".amended");
  fs::remove_all(made);  // what a process left that was killed around the exchange
  StagingDirectory staging(made);
  const fs::path& folder = staging.path();
  progress.begin("completing the package", 2, "steps");
  Manifest with = manifest;
  std::erase_if(with.artifacts, [&](const Artifact& artifact) { return amendment.roles.contains(artifact.role); });
  copy_unchanged(whole, manifest, with, folder);
  AmendedPackage result;
  for (Artifact& artifact : amendment.write(folder)) {
    result.added_bytes += artifact.size;
    with.artifacts.push_back(std::move(artifact));
  }
  progress.advance();
  for (const Artifact& artifact : with.artifacts) result.bytes += artifact.size;
  result.findings = check_budget(mission, result.bytes);
  if (result.findings.has_errors()) {
    progress.end();
    return result;
  }
  write_manifest(folder, with);
  if (key != nullptr) sign_package(folder, *key);
  result.is_signed = key != nullptr;
  progress.advance();  // the last moment to be interrupted
  staging.commit();
  progress.end();
  exchange(made, whole);
  fs::remove_all(made);
  return result;
}

}  // namespace nadir
