#include "base/error.hpp"
#include "base/files.hpp"
#include "package/verify_parts.hpp"
#include "trust/signed_document.hpp"
#include "trust/signatures.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

// A regular file of bounded size, or nothing and a finding.
std::optional<Bytes> read_bounded(const fs::path& file, std::uint64_t max_size, const char* missing_code,
                                  const char* invalid_code, Findings& findings) {
  const fs::file_status status = fs::symlink_status(file);
  if (!fs::exists(status)) {
    findings.add({.code = missing_code,
                  .where = file.filename().string(),
                  .expected = "a file that every package has",
                  .found = "none",
                  .fix = "sign the package, or get it again whole"});
    return std::nullopt;
  }
  if (!fs::is_regular_file(status) || fs::file_size(file) > max_size) {
    findings.add({.code = invalid_code,
                  .where = file.filename().string(),
                  .expected = "a regular file of at most " + std::to_string(max_size) + " bytes",
                  .found = fs::is_regular_file(status) ? std::to_string(fs::file_size(file)) + " bytes"
                                                       : "a link, folder or device"});
    return std::nullopt;
  }
  return read_file(file, max_size);
}

std::optional<Envelope> read_envelope(ByteView bytes, Findings& findings) {
  const auto refuse = [&findings](std::string expected, std::string found) {
    findings.add({.code = "signature.invalid",
                  .where = std::string(kSignatureFile),
                  .expected = std::move(expected),
                  .found = std::move(found),
                  .fix = "get the package again from its makers"});
  };
  try {
    Envelope envelope = parse_envelope(as_text(bytes), kSignatureFile);
    if (envelope.payload_type == kManifestPayloadType) return envelope;
    refuse("payload type " + std::string(kManifestPayloadType), envelope.payload_type.substr(0, 80));
  } catch (const Error& error) {
    refuse(error.text().expected.empty() ? "a signature envelope" : error.text().expected,
           error.text().found.empty() ? error.text().what : error.text().found);
  }
  return std::nullopt;
}

}  // namespace

void verify_signature(const fs::path& package, const TrustRoot& root, const VerifyOptions& options,
                      Verification& result) {
  const auto signature = read_bounded(package / kSignatureFile, kMaxEnvelopeSize, "signature.missing",
                                      "signature.invalid", result.findings);
  const auto manifest =
      read_bounded(package / kManifestFile, kMaxManifestSize, "artifact.missing", "manifest.schema", result.findings);
  if (!signature || !manifest) return;
  const auto envelope = read_envelope(*signature, result.findings);
  if (!envelope) return;
  SignatureCheck check = check_signatures(root, root.package_signer, envelope->signatures, kManifestPayloadType,
                                          *manifest, options.at, kSignatureFile);
  result.findings.add(check.findings);
  if (check.findings.refuses()) return;
  result.signers = std::move(check.signers);
  ManifestReading reading = parse_manifest(*manifest);
  result.findings.add(reading.findings);
  result.manifest = std::move(reading.manifest);
}

}  // namespace nadir
