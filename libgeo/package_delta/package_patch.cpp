#include "package_delta/package_patch.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "base/json.hpp"
#include "package/manifest.hpp"
#include "package/package_writer.hpp"
#include "package/verify.hpp"
#include "package_delta/file_delta.hpp"
#include "trust/signatures.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::size_t kMaxFiles = 1000;
constexpr std::uint64_t kMaxFile_bytes = std::uint64_t{1} << 44;
constexpr std::size_t kPrefix_bytes = kPatchMagic.size() + sizeof(std::uint32_t);
constexpr std::uint64_t kStep_bytes = std::uint64_t{1} << 20;

// Progress in MiB of the new package's files.
class ByteProgress {
 public:
  ByteProgress(Progress& progress, std::string_view label, std::uint64_t bytes) : progress_(progress) {
    progress_.begin(label, bytes / kStep_bytes + 1, "MiB");
  }
  ~ByteProgress() { progress_.end(); }
  ByteProgress(const ByteProgress&) = delete;
  ByteProgress& operator=(const ByteProgress&) = delete;

  void add(std::uint64_t bytes) {
    since_ += bytes;
    if (since_ < kStep_bytes) return;
    progress_.advance(since_ / kStep_bytes);
    since_ %= kStep_bytes;
  }

 private:
  Progress& progress_;
  std::uint64_t since_ = 0;
};

json json_of(const FileFacts& facts) { return {{"size", facts.size}, {"sha256", facts.sha256.hex()}}; }

json json_of(const PatchedPackage& package) {
  return {{"series", package.series}, {"sequence", package.sequence}, {"manifest_sha256", package.manifest.hex()}};
}

json json_of(const PatchHeader& header) {
  json files = json::array();
  for (const PatchedFile& file : header.files) {
    json item = json_of(file.facts);
    item["path"] = file.path;
    if (file.old_file) item["old"] = json_of(*file.old_file);
    if (file.body) item["body"] = json_of(*file.body);
    files.push_back(std::move(item));
  }
  return {{"schema", kPatchSchema}, {"from", json_of(header.from)}, {"to", json_of(header.to)}, {"files", files}};
}

FileFacts read_facts(const JsonReader& in) {
  return {in.integer<std::uint64_t>("size", 0, kMaxFile_bytes), in.digest("sha256")};
}

PatchedPackage read_package(const JsonReader& in) {
  PatchedPackage package{in.text("series", {.least = 1, .most = 64}),
                         in.integer<std::int64_t>("sequence", 0, std::numeric_limits<std::int64_t>::max()),
                         in.digest("manifest_sha256")};
  in.finish();
  return package;
}

PatchedFile read_file_entry(const JsonReader& in) {
  PatchedFile file{in.text("path"), read_facts(in), std::nullopt, std::nullopt};
  if (path_problem(file.path)) in.refuse("path", "a name inside the package");
  if (const auto old_file = in.optional_object("old")) {
    file.old_file = read_facts(*old_file);
    old_file->finish();
  }
  if (const auto body = in.optional_object("body")) {
    file.body = read_facts(*body);
    body->finish();
  }
  if (!file.body && file.old_file != file.facts) in.refuse("path", "a body for a file that is not the old one");
  in.finish();
  return file;
}

// The files of a package folder: its manifest, its signature, its artifacts, and roots of trust.
std::map<std::string, InputFile> files_of(const Directory& package) {
  std::map<std::string, InputFile> files;
  package.walk([&](const Directory::Entry& entry) {
    if (entry.kind != Directory::Kind::file || path_problem(entry.name) || files.size() >= kMaxFiles) {
      throw Error({.what = "cannot make a patch of this package",
                   .where = package.path() / entry.name,
                   .expected = fmt::format("at most {} files with the names of a package's files", kMaxFiles),
                   .found = entry.kind == Directory::Kind::file ? "another file" : "something else",
                   .fix = "remove it: it is no part of the package"});
    }
    files.emplace(entry.name, package.open(entry.name));
    return true;
  });
  return files;
}

PatchedPackage describe(const fs::path& package) {
  const Manifest manifest = load_package_manifest(package);
  return {manifest.series, manifest.sequence, sha256_file(package / kManifestFile)};
}

std::string text_of(const PatchedPackage& package) {
  return fmt::format("series {}, sequence {}, manifest {}", package.series, package.sequence, package.manifest.hex());
}

FileFacts facts_of(const InputFile& file) { return {file.size(), file.sha256()}; }

std::array<std::uint8_t, 4> little_endian(std::uint32_t value) {
  std::array<std::uint8_t, 4> bytes{};
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<std::uint8_t>(value >> (8 * i));
  return bytes;
}

[[noreturn]] void damaged(const fs::path& patch, std::string expected, std::string found) {
  throw Error({.what = "the patch is damaged",
               .where = patch,
               .expected = std::move(expected),
               .found = std::move(found),
               .fix = "transfer it again"});
}

// Every body, against its digest. Before any of them is interpreted.
void check_bodies(const InputFile& patch, const SignedPatch& signed_patch) {
  std::uint64_t at = signed_patch.bodies_at;
  for (const PatchedFile& file : signed_patch.header.files) {
    if (!file.body) continue;
    if (file.body->size > patch.size() - at) {
      damaged(patch.path(), fmt::format("{} bytes for {}", file.body->size, file.path),
              fmt::format("{} bytes", patch.size() - at));
    }
    Sha256Stream digest;
    Bytes buffer(kStep_bytes);
    const ByteSource body = source_of(patch, at, file.body->size);
    while (const std::size_t size = body(buffer)) digest.update(ByteView(buffer).first(size));
    if (digest.finish() != file.body->sha256)
      damaged(patch.path(), "the bytes that were signed", "others for " + file.path);
    at += file.body->size;
  }
  if (at != patch.size()) damaged(patch.path(), fmt::format("{} bytes", at), fmt::format("{} bytes", patch.size()));
}

// Writes one file of the new package, and checks it.
void make_file(const PatchedFile& file, const Directory& old_package, const ByteSource& body, const fs::path& target,
               ByteProgress& progress) {
  fs::create_directories(target.parent_path());
  AppendFile out(target);
  Sha256Stream digest;
  std::uint64_t written = 0;
  const ByteSink write = [&](ByteView bytes) {
    written += bytes.size();
    if (written > file.facts.size) {
      throw Error({.what = "a file of the new package becomes too large",
                   .where = file.path,
                   .expected = fmt::format("{} bytes", file.facts.size),
                   .fix = "ask for the whole package: the old one or the patch is not what it should be"});
    }
    digest.update(bytes);
    out.append(bytes);
    progress.add(bytes.size());
  };
  std::optional<InputFile> old_file;
  if (file.old_file) old_file = old_package.open(file.path);
  if (file.body) {
    apply_file_delta(old_file ? &*old_file : nullptr, body, write);
  } else {
    Bytes buffer(kStep_bytes);
    const ByteSource all = source_of(*old_file, 0, old_file->size());
    while (const std::size_t size = all(buffer)) write(ByteView(buffer).first(size));
  }
  if (const FileFacts made{written, digest.finish()}; made == file.facts) return;
  const bool old_is_other = old_file && facts_of(*old_file) != *file.old_file;
  throw Error({.what = old_is_other ? "the old package is damaged" : "the patch does not make the new file",
               .where = file.path,
               .expected = "sha256 " + (old_is_other ? file.old_file->sha256 : file.facts.sha256).hex(),
               .found = "another digest",
               .fix = "ask for the whole package"});
}

}  // namespace

SignedPatch parse_patch(ByteView header, std::string_view name) {
  const json document = parse_json(as_text(header), name, {.max_depth = 6, .allow_floats = false});
  SignedPatch patch{.header = {}, .document = split_signed_document(document, name)};
  const JsonReader parts(document, {.name = std::string(name), .what = "cannot read the patch"});
  const JsonReader in = parts.object("signed");
  in.expect("schema", kPatchSchema);
  patch.header.from = read_package(in.object("from"));
  patch.header.to = read_package(in.object("to"));
  const JsonReader files = in.array("files", {.least = 1, .most = kMaxFiles});
  for (std::size_t i = 0; i < files.size(); ++i) {
    patch.header.files.push_back(read_file_entry(files.object(i)));
    if (i > 0 && patch.header.files[i - 1].path >= patch.header.files[i].path) {
      files.refuse(i, "files in the order of their paths, each once");
    }
  }
  in.finish();
  return patch;
}

SignedPatch read_patch(const InputFile& patch) {
  std::array<std::uint8_t, kPrefix_bytes> prefix{};
  if (!patch.read_at(0, prefix) || as_text(prefix).substr(0, kPatchMagic.size()) != kPatchMagic) {
    throw Error({.what = "this is no patch of a package",
                 .where = patch.path(),
                 .expected = fmt::format("a file that begins with {}", kPatchMagic),
                 .found = "another file",
                 .fix = "give a file of `nadir cache diff OLD NEW --patch FILE`"});
  }
  std::uint32_t size = 0;
  for (std::size_t i = 0; i < sizeof size; ++i) size |= std::uint32_t{prefix[kPatchMagic.size() + i]} << (8 * i);
  Bytes header(std::min(size, kMaxPatchHeader));
  if (size > kMaxPatchHeader || !patch.read_at(kPrefix_bytes, header)) {
    damaged(patch.path(), fmt::format("a header of at most {} bytes", kMaxPatchHeader),
            fmt::format("one of {} bytes in a file of {}", size, patch.size()));
  }
  SignedPatch read = parse_patch(header, patch.path().string());
  read.bodies_at = kPrefix_bytes + size;
  return read;
}

MadePatch make_patch(const fs::path& old_package, const fs::path& new_package,
                     const std::vector<const PrivateKey*>& keys, const fs::path& out, Progress& progress) {
  MadePatch made;
  made.header.from = describe(old_package);
  made.header.to = describe(new_package);
  if (made.header.from.manifest == made.header.to.manifest) {
    throw UsageError({.what = "both are the same package",
                      .where = new_package,
                      .expected = "another package than " + old_package.string(),
                      .found = text_of(made.header.to)});
  }
  made.findings = check_before_signing(new_package, progress);
  if (made.findings.has_errors()) return made;
  const auto old_files = files_of(Directory(old_package)), new_files = files_of(Directory(new_package));
  for (const auto& [path, file] : new_files) made.package_bytes += file.size();

  ByteProgress bytes(progress, "comparing", made.package_bytes);
  PendingFile bodies(out, {});  // unnamed, beside the patch: where the container changes they are a whole package
  for (const auto& [path, file] : new_files) {
    PatchedFile& entry = made.header.files.emplace_back(PatchedFile{path, facts_of(file), std::nullopt, std::nullopt});
    const auto old_file = old_files.find(path);
    if (old_file != old_files.end()) entry.old_file = facts_of(old_file->second);
    if (entry.old_file != entry.facts) {
      const std::uint64_t begin = bodies.size();
      Sha256Stream digest;
      make_file_delta(entry.old_file ? &old_file->second : nullptr, file, [&](ByteView part) {
        digest.update(part);
        bodies.append(part);
      });
      entry.body = FileFacts{bodies.size() - begin, digest.finish()};
    }
    bytes.add(file.size());
  }
  SignedDocument document{json_of(made.header).dump(), {}};
  for (const PrivateKey* key : keys) {
    document.put(sign_payload(*key, kPatchPayloadType, as_bytes(document.signed_bytes)));
  }
  const std::string header = document.json();
  parse_patch(as_bytes(header), out.string());
  const auto length = little_endian(static_cast<std::uint32_t>(header.size()));
  PendingFile file(out, as_bytes(kPatchMagic));
  file.append(length);
  file.append(as_bytes(header));
  Bytes buffer(kStep_bytes);
  for (std::uint64_t at = 0; at < bodies.size(); at += buffer.size()) {
    const std::span part = std::span(buffer).first(std::min<std::uint64_t>(buffer.size(), bodies.size() - at));
    if (!bodies.read_at(at, part)) throw Error({.what = "cannot read what was written a moment ago", .where = out});
    file.append(part);
  }
  file.replace();
  made.bytes = file.size();
  return made;
}

AppliedPatch apply_patch(const PatchRequest& request, Progress& progress) {
  const InputFile patch(request.patch);
  const SignedPatch signed_patch = read_patch(patch);
  AppliedPatch applied;
  applied.header = signed_patch.header;
  applied.findings =
      check_signatures(*request.root, request.root->package_signer, signed_patch.document.signatures, kPatchPayloadType,
                       as_bytes(signed_patch.document.signed_bytes), request.at, request.patch.string())
          .findings;
  if (applied.findings.has_errors()) return applied;
  if (const PatchedPackage old_package = describe(request.old_package);
      old_package.manifest != applied.header.from.manifest) {
    throw Error({.what = "the patch is for another package",
                 .where = request.old_package,
                 .expected = text_of(applied.header.from),
                 .found = text_of(old_package),
                 .fix = "ask for a patch from this package, or for the whole new one"});
  }
  check_bodies(patch, signed_patch);
  for (const PatchedFile& file : applied.header.files) applied.package_bytes += file.facts.size;

  const Directory old_package(request.old_package);
  StagingDirectory staging(request.out);
  {
    ByteProgress bytes(progress, "applying", applied.package_bytes);
    std::uint64_t at = signed_patch.bodies_at;
    for (const PatchedFile& file : applied.header.files) {
      const std::uint64_t size = file.body ? file.body->size : 0;
      make_file(file, old_package, source_of(patch, at, size), staging.path() / file.path, bytes);
      at += size;
    }
  }
  VerifyOptions options;
  options.root = request.root;
  options.at = request.at;
  applied.findings.add(verify_package(staging.path(), options, progress).findings);
  if (!applied.findings.has_errors()) staging.commit();
  return applied;
}

}  // namespace nadir
