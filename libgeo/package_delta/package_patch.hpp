// A patch makes one package of another: what a ground station sends over a thin link instead of the whole new package.
// The result has the new package's bytes, its manifest and signatures included, or it does not come into being.
//
//   "NADIRPCH"   8 bytes
//   length       4 bytes, little-endian: of the header
//   header       {"signed": {…}, "signatures": [{"keyid", "sig"}]}   (trust/signed_document.hpp)
//   bodies       one after the other, in the order of the header's files
//
// The header names both packages by the SHA-256 of their manifests, and of each file of the new package its size and
// digest: a file with a body is made by it, out of the old package's file of the same name if the header names one;
// a file without a body is the old one. Signers are those of packages, with the same threshold: nothing of a patch is
// read before its signature has passed, and no body before its digest has. docs/formats/patch.md is the reference.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/input_file.hpp"
#include "base/progress.hpp"
#include "base/time.hpp"
#include "trust/root.hpp"
#include "trust/signed_document.hpp"

namespace nadir {

inline constexpr std::string_view kPatchMagic = "NADIRPCH";
inline constexpr std::string_view kPatchSchema = "nadir.package-patch/1";
inline constexpr std::string_view kPatchPayloadType = "application/vnd.nadir.package-patch.v1+json";
inline constexpr std::uint32_t kMaxPatchHeader = std::uint32_t{1} << 20;

struct FileFacts {
  std::uint64_t size = 0;
  Sha256 sha256;

  bool operator==(const FileFacts&) const = default;
};

struct PatchedFile {
  std::string path;
  FileFacts facts;                    // of the new file
  std::optional<FileFacts> old_file;  // that it is made of
  std::optional<FileFacts> body;      // none: the old file as it is
};

struct PatchedPackage {
  std::string series;
  std::int64_t sequence = 0;
  Sha256 manifest;
};

struct PatchHeader {
  PatchedPackage from, to;
  std::vector<PatchedFile> files;  // sorted by path
};

struct SignedPatch {
  PatchHeader header;
  SignedDocument document;
  std::uint64_t bodies_at = 0;  // in the file
};

// Form alone: strict. Throws Error.
SignedPatch parse_patch(ByteView header, std::string_view name);
SignedPatch read_patch(const InputFile& patch);

struct MadePatch {
  Findings findings;  // refuse: the new package is not what its manifest says, and nothing was written
  PatchHeader header;
  std::uint64_t bytes = 0, package_bytes = 0;  // of the patch, and of the new package
};

// Throws UsageError when one of the two is no package, or both are the same one; Error for what cannot be read.
MadePatch make_patch(const std::filesystem::path& old_package, const std::filesystem::path& new_package,
                     const std::vector<const PrivateKey*>& keys, const std::filesystem::path& out, Progress& progress);

struct PatchRequest {
  std::filesystem::path old_package, patch, out;
  const TrustRoot* root = nullptr;
  UtcTime at;
};

struct AppliedPatch {
  Findings findings;  // refuse: nothing was written. Of the patch's signature, or of the new package
  PatchHeader header;
  std::uint64_t package_bytes = 0;
};

// The old package is only read. The new one appears under its name when it is whole, on the disk and verified (quick
// depth); a process that is killed before leaves a hidden folder, which the next one removes. Throws Error when the
// patch is for another package, is damaged, or the old package is.
AppliedPatch apply_patch(const PatchRequest& request, Progress& progress);

}  // namespace nadir
