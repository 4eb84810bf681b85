#include "package/verify.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>

#include "base/error.hpp"
#include "base/fs_verity.hpp"
#include "package/mission_check.hpp"
#include "package/package_roots.hpp"
#include "package/tile_container.hpp"
#include "trust/signatures.hpp"
#include "trust/signed_document.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {
// A regular file of bounded size, or nothing and a finding.
std::optional<Bytes> read_bounded(const Directory& package, std::string_view name, std::uint64_t max_size,
                                  const char* missing_code, const char* invalid_code, Findings& findings) {
  try {
    const std::optional<InputFile> file = package.find(name);
    if (file) return file->read(max_size);
    findings.add({.code = missing_code,
                  .where = std::string(name),
                  .expected = "a file required in every package",
                  .found = "none",
                  .fix = "sign the package, or get a complete copy"});
  } catch (const Error& error) {
    findings.add({.code = invalid_code,
                  .where = std::string(name),
                  .expected = fmt::format("a regular file of at most {} bytes", max_size),
                  .found = error.text().found});
  }
  return std::nullopt;
}

std::optional<Envelope> read_envelope(ByteView bytes, Findings& findings) {
  const auto refuse = [&findings](std::string expected, std::string found) {
    findings.add({.code = "signature.invalid",
                  .where = std::string(kSignatureFile),
                  .expected = std::move(expected),
                  .found = std::move(found),
                  .fix = "get the package again from its producer"});
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

// Signature over the manifest's exact bytes, then the manifest. Fills signers and manifest; without a manifest
// nothing else may be looked at.
void verify_signature(const Directory& package, const TrustRoot& root, const VerifyOptions& options,
                      Verification& result) {
  const auto signature = read_bounded(package, kSignatureFile, kMaxEnvelopeSize, "signature.missing",
                                      "signature.invalid", result.findings);
  const auto manifest =
      read_bounded(package, kManifestFile, kMaxManifestSize, "artifact.missing", "manifest.schema", result.findings);
  if (!signature || !manifest) return;
  const auto envelope = read_envelope(*signature, result.findings);
  if (!envelope) return;
  SignatureCheck check = check_signatures(root, root.package_signer, envelope->signatures, kManifestPayloadType,
                                          *manifest, options.at, kSignatureFile);
  result.findings.add(check.findings);
  if (check.findings.has_errors()) return;
  result.signers = std::move(check.signers);
  ManifestReading reading = parse_manifest(*manifest);
  result.findings.add(reading.findings);
  result.manifest = std::move(reading.manifest);
}

// Clocks of two machines differ, and missions are written the day before; more than this is no such thing.
constexpr std::int64_t kClockTolerance_s = 86'400;

// A clock that was corrected, or that drifted while the aircraft was off. Such a clock counts as the remembered time,
// so that nothing which had expired by then is valid again.
constexpr std::int64_t kClockSetback_s = 3600;

std::optional<UtcTime> remembered(const VerifyOptions& options) {
  return options.state != nullptr ? options.state->last_trusted_time : std::nullopt;
}

// The time by which the package is judged.
UtcTime judged_at(const VerifyOptions& options) {
  const std::optional<UtcTime> last = remembered(options);
  const bool corrected = last && options.at < *last && last->unix_s - options.at.unix_s <= kClockSetback_s;
  return corrected ? *last : options.at;
}

// The time that counts instead of the remembered one, when the permit allows it.
std::optional<UtcTime> permitted_time(UtcTime last, const TrustRoot& root, const VerifyOptions& options,
                                      Findings& findings) {
  if (options.time_permit == nullptr) return std::nullopt;
  const Findings objections = check_time_permit(*options.time_permit, root, {last, options.airframe, options.at});
  findings.add(objections);
  const UtcTime instead = options.time_permit->permit.instead;
  if (objections.has_errors() || options.at < instead) return std::nullopt;
  return instead;
}

// What a permit resets goes to time_reset.
void check_clock(const Manifest& manifest, const TrustRoot& root, const VerifyOptions& options, Findings& findings,
                 std::optional<UtcTime>& time_reset) {
  std::optional<UtcTime> earliest;
  std::string because;
  if (options.at.unix_s + kClockTolerance_s < manifest.created.unix_s) {
    earliest = manifest.created;
    because = "when the package was created";
  }
  if (const std::optional<UtcTime> last = remembered(options); last && options.at < *last) {
    time_reset = permitted_time(*last, root, options, findings);
    if (!time_reset && (!earliest || *earliest < *last)) {
      earliest = *last;
      because = "when this aircraft last accepted a package";
    }
  }
  if (time_reset) {
    findings.add({.code = "time.untrusted",
                  .severity = Severity::warning,
                  .where = "the clock",
                  .expected = fmt::format("not before {}, as remembered", to_rfc3339(*remembered(options))),
                  .found = fmt::format("{}, as the permit allows", to_rfc3339(options.at))});
  }
  if (!earliest) return;
  findings.add({.code = "time.untrusted",
                .where = "the clock",
                .expected = fmt::format("not before {}, {}", to_rfc3339(*earliest), because),
                .found = to_rfc3339(options.at),
                .fix =
                    "set the clock; expiry cannot be checked until then. If the remembered time is wrong: nadir keys "
                    "permit-time"});
}

void check_root(const TrustRoot& root, const VerifyOptions& options, Findings& findings) {
  if (root.expires <= options.at) {
    findings.add({.code = "key.expired",
                  .where = fmt::format("root version {}", root.version),
                  .expected = "a trust root that is valid at " + to_rfc3339(options.at),
                  .found = "expired " + to_rfc3339(root.expires),
                  .fix = "get the producer's newer root"});
  }
  if (options.state != nullptr && root.version < options.state->root_version) {
    findings.add({.code = "root.rollback",
                  .where = "the trust root",
                  .expected = fmt::format("version {} or later, as seen before", options.state->root_version),
                  .found = fmt::format("version {}", root.version),
                  .fix = "use the newest trust root"});
  }
}

void check_sequence(const Manifest& manifest, const TrustRoot& root, const VerifyOptions& options, Findings& findings) {
  if (options.state == nullptr) return;
  const auto seen = options.state->highest_sequence.find(manifest.series);
  if (seen == options.state->highest_sequence.end() || manifest.sequence >= seen->second) return;
  bool permitted = false;
  if (options.permit != nullptr) {
    const Findings objections = check_permit(
        *options.permit, root, {manifest.series, seen->second, manifest.sequence, options.airframe, options.at});
    findings.add(objections);
    permitted = !objections.has_errors();
  }
  findings.add({.code = "package.rollback",
                .severity = permitted ? Severity::warning : Severity::error,
                .where = "series " + manifest.series,
                .expected = fmt::format("sequence {} or later, as accepted before", seen->second),
                .found = fmt::format("sequence {}{}", manifest.sequence, permitted ? ", as the permit allows" : ""),
                .fix = permitted ? "" : "use the newest package of this series, or get a rollback permit"});
}

void check_airframe(const Manifest& manifest, const VerifyOptions& options, Findings& findings) {
  if (!options.airframe) return;
  const auto allows = [&](const std::string& name) { return name == kAnyAirframe || name == *options.airframe; };
  if (std::any_of(manifest.airframes.begin(), manifest.airframes.end(), allows)) return;
  findings.add({.code = "airframe.mismatch",
                .where = "manifest.json /airframes",
                .expected = "a package for airframe " + *options.airframe,
                .found = fmt::format("a package for {}", fmt::join(manifest.airframes, ", ")),
                .fix = "load the package that was made for this airframe"});
}

// Dates, clock, sequences and the permit to go back, airframe.
Findings verify_policy(const Manifest& manifest, const TrustRoot& root, const VerifyOptions& options,
                       std::optional<UtcTime>& time_reset) {
  Findings findings;
  check_clock(manifest, root, options, findings, time_reset);
  check_root(root, options, findings);
  if (manifest.expires <= options.at) {
    findings.add({.code = "package.expired",
                  .where = "manifest.json /expires",
                  .expected = "a package that is valid at " + to_rfc3339(options.at),
                  .found = "expired " + to_rfc3339(manifest.expires),
                  .fix = "build a new package with a later expiry"});
  }
  check_sequence(manifest, root, options, findings);
  check_airframe(manifest, options, findings);
  return findings;
}

// mission.yaml, as its bytes were hashed, against the manifest. Fills mission.
void verify_mission(const std::optional<Bytes>& text, Verification& result) {
  const Manifest& manifest = *result.manifest;
  const auto mismatch = [&result](std::string where, std::string expected, std::string found) {
    result.findings.add({.code = "mission.mismatch",
                         .where = std::move(where),
                         .expected = std::move(expected),
                         .found = std::move(found),
                         .fix = "build the package again from its mission"});
  };
  const Artifact* artifact = manifest.artifact(kRoleMission);
  if (artifact == nullptr) return mismatch("manifest.json", "an artifact of role \"mission\"", "none");
  if (!text) return;  // missing or damaged: its own finding is there
  MissionReading reading = parse_mission(as_text(*text), artifact->path);
  if (!reading.mission) {
    return mismatch(reading.findings.items().front().where, reading.findings.items().front().expected,
                    reading.findings.items().front().found);
  }
  const Mission& mission = *reading.mission;
  const auto compare = [&](const char* what, const std::string& in_manifest, const std::string& in_mission) {
    if (in_manifest != in_mission) mismatch(artifact->path + ", " + what, in_manifest, in_mission);
  };
  compare("id", manifest.mission_id, mission.id);
  compare("series", manifest.series, mission.series);
  compare("sequence", std::to_string(manifest.sequence), std::to_string(mission.sequence));
  compare("created", to_rfc3339(manifest.created), to_rfc3339(mission.created));
  compare("expires", to_rfc3339(manifest.expires), to_rfc3339(mission.expires));
  compare("airframes", fmt::format("{}", fmt::join(manifest.airframes, ", ")),
          fmt::format("{}", fmt::join(mission.airframes, ", ")));
  result.mission = std::move(reading.mission);
}

constexpr std::size_t kMaxUnexpected = 50;
constexpr std::size_t kMaxPackageFiles = 10'000;
constexpr std::uint64_t kHashedBlock_bytes = std::uint64_t{1} << 20;
constexpr std::uint64_t kMaxMission_bytes = std::uint64_t{1} << 20;

// The files on disk against the artifacts. Imagery and terrain are hashed at full depth only, everything else
// always. A file of another size than the signed one is not opened by anything that understands its content.
struct FileCheck {
  Findings findings;
  // Artifacts that are there with their size (and, where hashed, their digest), by path. The imagery stays when its
  // digest is wrong: its tiles show what was changed.
  std::map<std::string, InputFile> sound;
  bool imagery_differs = false;
  std::optional<Bytes> mission;  // the bytes that were hashed
};

// A file that states several digests has one set of bytes that fits them all, if its signer compared each of them. So
// whoever trusts the signature compares one, the fastest; whoever is about to sign compares all.
enum class Compare { one_digest, all_digests };

struct HashingOptions {
  VerifyDepth depth = VerifyDepth::quick;
  Compare compare = Compare::one_digest;
  int threads = 1;
};

class FileVerifier {
 public:
  FileVerifier(const Directory& package, const Manifest& manifest, const HashingOptions& options, Progress& progress)
      : package_(package), manifest_(manifest), options_(options), progress_(progress) {}

  FileCheck run() {
    walk();
    std::uint64_t to_hash = 0;
    for (const Artifact& artifact : manifest_.artifacts) to_hash += hashes(artifact) ? artifact.size : 0;
    progress_.begin("hashing", to_hash / kHashedBlock_bytes + 1, "MiB");
    for (const Artifact& artifact : manifest_.artifacts) verify(artifact);
    progress_.end();
    return std::move(check_);
  }

 private:
  bool hashes(const Artifact& artifact) const {
    return options_.depth == VerifyDepth::full || (artifact.role != kRoleImagery && artifact.role != kRoleTerrain);
  }

  // Every file in the folder must be named in the manifest and be a regular file.
  void walk() {
    std::set<std::string> named{std::string(kManifestFile), std::string(kSignatureFile)};
    for (const Artifact& artifact : manifest_.artifacts) named.insert(artifact.path);
    std::size_t entries = 0;
    package_.walk([&](const Directory::Entry& entry) {
      if (++entries > kMaxPackageFiles) {
        unexpected(entry.name, "more than 10000 files");
        return false;
      }
      if (entry.kind != Directory::Kind::file) {
        unexpected(entry.name, entry.kind == Directory::Kind::link ? "a symbolic link" : "not a regular file");
      } else if (!named.contains(entry.name) && !is_root_file_name(entry.name)) {  // those: walk_package_roots()
        unexpected(entry.name, "a file");
      }
      return true;
    });
  }

  void unexpected(const std::string& path, std::string found) {
    if (++unexpected_ > kMaxUnexpected) return;
    check_.findings.add({.code = "artifact.unexpected",
                         .where = path,
                         .expected = "only the files that the manifest names",
                         .found = std::move(found),
                         .fix = "get the package again from its producer"});
  }

  void verify(const Artifact& artifact) {
    const auto report = [&](const char* code, std::string expected, std::string found) {
      check_.findings.add({.code = code,
                           .where = artifact.path,
                           .expected = std::move(expected),
                           .found = std::move(found),
                           .fix = "get the package again from its producer"});
    };
    std::optional<InputFile> file;
    try {
      file = package_.find(artifact.path);
    } catch (const Error& error) {  // a link, a pipe, a folder, or no permission
      return report("artifact.missing", "a regular file", error.text().found);
    }
    if (!file) return report("artifact.missing", "a regular file", "none");
    if (file->size() != artifact.size) {
      return report("artifact.size", fmt::format("{} bytes", artifact.size), fmt::format("{} bytes", file->size()));
    }
    if (hashes(artifact)) {
      const auto [expected, found] = hash(artifact, *file);
      if (expected != found) {
        report("artifact.hash", expected, found);
        if (artifact.role != kRoleImagery) return;
        check_.imagery_differs = true;
      }
    }
    check_.sound.emplace(artifact.path, std::move(*file));
  }

  struct Compared {
    std::string expected, found;
  };
  Compared hash(const Artifact& artifact, const InputFile& file) {
    if (!artifact.fsverity) return {artifact.sha256.hex(), sha256_of(artifact, file).hex()};
    const auto advance = [this] { progress_.advance(); };
    const auto text = [](const Sha256& digest) { return "fs-verity " + digest.hex(); };
    if (options_.compare == Compare::one_digest) {
      return {text(*artifact.fsverity), text(verity_digest(file, options_.threads, advance))};
    }
    const auto [whole, verity] = digests_of(file, advance);
    if (verity == *artifact.fsverity) return {artifact.sha256.hex(), whole.hex()};
    return {text(*artifact.fsverity), text(verity)};
  }

  Sha256 sha256_of(const Artifact& artifact, const InputFile& file) {
    if (artifact.role != kRoleMission || artifact.size > kMaxMission_bytes) {
      return file.sha256([this] { progress_.advance(); });
    }
    Bytes text = file.read(kMaxMission_bytes);
    const Sha256 digest = sha256(text);
    if (digest == artifact.sha256 && manifest_.artifact(kRoleMission) == &artifact) check_.mission = std::move(text);
    return digest;
  }

  const Directory& package_;
  const Manifest& manifest_;
  HashingOptions options_;
  Progress& progress_;
  FileCheck check_;
  std::size_t unexpected_ = 0;
};

Directory open_folder(const fs::path& package) {
  const auto refuse = [&package](std::string found) {
    throw Error({.what = "not a mission package",
                 .where = package,
                 .expected = "a folder with manifest.json and manifest.sig",
                 .found = std::move(found),
                 .fix = "give the folder that `nadir cache build --out` created"});
  };
  std::error_code code;
  const fs::file_status status = fs::status(package, code);
  if (status.type() == fs::file_type::not_found) refuse("no such path");
  if (!code && !fs::is_directory(status)) refuse("not a folder");
  Directory folder(package);
  bool anything = false;
  for (const std::string_view name : {kManifestFile, kSignatureFile}) {
    try {
      anything = anything || folder.find(name).has_value();
    } catch (const Error&) {
      anything = true;  // something of this name
    }
  }
  if (!anything) refuse("a folder with neither");
  return folder;
}

// Reads the tile set. Fills imagery and tiles.
void verify_tile_set(const FileCheck& files, VerifyDepth depth, Progress& progress, Verification& result) {
  const Artifact* imagery = result.manifest->artifact(kRoleImagery);
  if (imagery == nullptr || !imagery->tiles) {
    result.findings.add({.code = "manifest.schema",
                         .where = "manifest.json /artifacts",
                         .expected = "an artifact of role \"imagery\" with \"tiles\"",
                         .found = "none"});
    return;
  }
  const auto tiles = files.sound.find(imagery->path);
  if (tiles == files.sound.end()) return;  // its own finding is there
  TileSetFiles opened{tiles->second.duplicate(), std::nullopt};
  // The sidecars of a COG are an artifact of their own.
  if (const Artifact* sidecars = result.manifest->artifact(kRoleSidecars); sidecars != nullptr) {
    const auto beside = files.sound.find(sidecars->path);
    if (beside == files.sound.end()) return;
    opened.sidecars = beside->second.duplicate();
  }
  result.imagery = std::make_shared<const InputFile>(tiles->second.duplicate());
  TileSetCheck check = check_tile_set(std::move(opened), *imagery->tiles, depth, progress);
  result.findings.add(check.findings);
  result.tiles = std::move(check.sidecars);
}

// Where the file is the one that was signed, so are its tiles. Where it is not, each of them is hashed, to name those
// that differ.
void verify_imagery(const VerifyOptions& options, const FileCheck& files, Progress& progress, Verification& result) {
  verify_tile_set(files, files.imagery_differs ? VerifyDepth::full : VerifyDepth::quick, progress, result);
  const bool readable = !result.findings.contains("sqlite.corrupt") && !result.findings.contains("tiff.corrupt");
  if (result.imagery && readable && result.mission) {
    result.findings.add(check_tile_requirements(*result.mission, result.tiles, result.bytes, options.at));
  }
}

// At quick depth open_package() reads the terrain.
void verify_terrain(const VerifyOptions& options, const FileCheck& files, Verification& result) {
  if (!result.mission) return;
  result.findings.add(check_terrain_presence(*result.manifest, *result.mission));
  const Artifact* terrain = result.manifest->artifact(kRoleTerrain);
  if (options.depth != VerifyDepth::full || terrain == nullptr || !files.sound.contains(terrain->path)) return;
  TerrainReading reading = read_package_terrain(*result.folder, *result.manifest, *result.mission);
  result.findings.add(reading.findings);
  result.terrain = std::move(reading.terrain);
}

}  // namespace

void remember(AircraftState& state, const Verification& accepted, UtcTime at) {
  const Manifest& manifest = accepted.manifest.value();
  if (accepted.time_reset) state.last_trusted_time = accepted.time_reset;
  state.accept(manifest.series, manifest.sequence, accepted.root_version, remembered_time(at, manifest.created),
               accepted.newer_roots);
}

namespace {

// What the manifest names: files, mission, terrain, imagery.
void verify_contents(const VerifyOptions& options, Progress& progress, Verification& result) {
  for (const Artifact& artifact : result.manifest->artifacts) result.bytes += artifact.size;
  const HashingOptions hashing{.depth = options.depth, .threads = options.threads};
  const FileCheck files = FileVerifier(*result.folder, *result.manifest, hashing, progress).run();
  result.findings.add(files.findings);
  verify_mission(files.mission, result);
  verify_terrain(options, files, result);
  verify_imagery(options, files, progress, result);
}

}  // namespace

Verification verify_accepted_package(const fs::path& package, const Sha256& manifest, UtcTime accepted_at,
                                     Progress& progress) {
  Verification result;
  result.folder = std::make_shared<const Directory>(open_folder(package));
  const auto bytes = read_bounded(*result.folder, kManifestFile, kMaxManifestSize, "artifact.missing",
                                  "manifest.schema", result.findings);
  if (!bytes) return result;
  if (const Sha256 found = sha256(*bytes); found != manifest) {
    result.findings.add({.code = "artifact.hash",
                         .where = std::string(kManifestFile),
                         .expected = manifest.hex() + ", as accepted for this flight",
                         .found = found.hex(),
                         .fix = "put the accepted package back"});
    return result;
  }
  ManifestReading reading = parse_manifest(*bytes);
  result.findings.add(reading.findings);
  result.manifest = std::move(reading.manifest);
  if (!result.manifest) return result;
  VerifyOptions options;
  options.at = accepted_at;
  verify_contents(options, progress, result);
  return result;
}

Verification verify_package(const fs::path& package, const VerifyOptions& asked, Progress& progress) {
  VerifyOptions options = asked;
  options.at = judged_at(asked);
  Verification result;
  result.folder = std::make_shared<const Directory>(open_folder(package));
  const Directory& folder = *result.folder;
  RootSuccession walk = walk_package_roots(folder, *options.root, options.state, options.at);
  result.findings.add(walk.findings);
  result.newest_root = walk.root;
  result.root_version = walk.root.version;
  result.newer_roots = std::move(walk.newer);
  verify_signature(folder, walk.root, options, result);
  if (!result.manifest) return result;
  result.findings.add(verify_policy(*result.manifest, walk.root, options, result.time_reset));
  verify_contents(options, progress, result);
  return result;
}

Findings check_before_signing(const fs::path& package, Progress& progress) {
  const Directory folder(package);
  ManifestReading reading = parse_manifest(folder.open(kManifestFile).read(kMaxManifestSize));
  if (!reading.manifest) return reading.findings;
  Verification result;
  result.manifest = std::move(reading.manifest);
  const HashingOptions hashing{.depth = VerifyDepth::full, .compare = Compare::all_digests};
  const FileCheck files = FileVerifier(folder, *result.manifest, hashing, progress).run();
  result.findings.add(files.findings);
  verify_mission(files.mission, result);
  verify_tile_set(files, VerifyDepth::full, progress, result);
  return result.findings;
}

}  // namespace nadir
