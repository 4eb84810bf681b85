#include "package/sign_package.hpp"

#include "base/error.hpp"
#include "base/files.hpp"
#include "package/verify_parts.hpp"
#include "trust/signed_document.hpp"

namespace nadir {
namespace fs = std::filesystem;

void write_manifest(const std::filesystem::path& package, const Manifest& manifest) {
  const std::string bytes = manifest_json(manifest);
  const ManifestReading check = parse_manifest(as_bytes(bytes));
  if (!check.manifest) {
    const Finding& first = check.findings.items().front();
    throw Error({.what = "this manifest would be refused by every reader",
                 .where = first.where,
                 .expected = first.expected,
                 .found = first.found});
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
      throw UsageError({.what = "cannot add to the signatures that are there",
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

Findings check_before_signing(const fs::path& package, Progress& progress) {
  ManifestReading reading = parse_manifest(read_file(package / kManifestFile, kMaxManifestSize));
  if (!reading.manifest) return reading.findings;
  Verification result;
  result.manifest = std::move(reading.manifest);
  const FileCheck files = verify_files(package, *result.manifest, VerifyDepth::full, progress);
  result.findings.add(files.findings);
  const Artifact* mission = result.manifest->artifact(kRoleMission);
  if (mission == nullptr || files.sound.contains(mission->path)) verify_mission(package, result);
  return result.findings;
}

}  // namespace nadir
