#include "package/root_folder.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

constexpr std::string_view kSuffix = ".root.json";
constexpr std::size_t kMaxDigits = 9;
constexpr std::size_t kMaxEntries = 10'000;

// The version that a file's name says; 0 for other names.
std::int64_t version_of(std::string_view file_name) {
  if (!file_name.ends_with(kSuffix)) return 0;
  const std::string_view digits = file_name.substr(0, file_name.size() - kSuffix.size());
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  if (digits.empty() || digits.size() > kMaxDigits || digits.front() == '0' ||
      !std::all_of(digits.begin(), digits.end(), is_digit)) {
    return 0;
  }
  return std::stoll(std::string(digits));
}

std::optional<RootDocument> read_carried(const fs::path& package, std::int64_t version) {
  const std::string name = root_file_name(version);
  // A linked folder would lead out of the package.
  if (!fs::is_directory(fs::symlink_status(package / kRootFolder))) return std::nullopt;
  const fs::file_status status = fs::symlink_status(package / name);
  if (!fs::is_regular_file(status)) return std::nullopt;  // links are artifact.unexpected
  // Not one byte of something larger is read; the empty text is then refused as no root.
  if (fs::file_size(package / name) > kMaxRootSize) return RootDocument{{}, name};
  return RootDocument{read_text_file(package / name, kMaxRootSize), name};
}

std::int64_t highest_carried(const fs::path& package) {
  std::int64_t highest = 0;
  if (!fs::is_directory(fs::symlink_status(package / kRootFolder))) return highest;
  std::size_t entries = 0;
  for (const fs::directory_entry& entry : fs::directory_iterator(package / kRootFolder)) {
    if (++entries > kMaxEntries) break;
    highest = std::max(highest, version_of(entry.path().filename().string()));
  }
  return highest;
}

}  // namespace

std::string root_file_name(std::int64_t version) { return fmt::format("{}/{}{}", kRootFolder, version, kSuffix); }

bool is_root_file_name(std::string_view path) {
  return path.starts_with(kRootFolder) && path.size() > kRootFolder.size() && path[kRootFolder.size()] == '/' &&
         version_of(path.substr(kRootFolder.size() + 1)) > 0;
}

RootWalk walk_package_roots(const fs::path& package, const TrustRoot& trusted, const AircraftState* state) {
  // What the aircraft remembers goes first: another root of the same version has come too late.
  RootWalk walk = walk_roots(trusted, [&](std::int64_t version) -> std::optional<RootDocument> {
    if (state != nullptr) {
      const auto remembered = state->roots.find(version);
      if (remembered != state->roots.end()) {
        return RootDocument{remembered->second, fmt::format("the aircraft's state, root version {}", version)};
      }
    }
    return read_carried(package, version);
  });
  const std::int64_t highest = highest_carried(package);
  if (!walk.findings.refuses() && highest > walk.root.version) {
    walk.findings.add({.code = "root.rollback",
                       .where = root_file_name(highest),
                       .expected = fmt::format("{}, which comes next", root_file_name(walk.root.version + 1)),
                       .found = "no such file, but later ones",
                       .fix = "let the package carry the roots between them as well"});
  }
  return walk;
}

void carry_root(const fs::path& package, const fs::path& root_file) {
  const std::string text = read_text_file(root_file, kMaxRootSize);
  const TrustRoot root = read_trusted_root(root_file);
  const fs::path target = package / root_file_name(root.version);
  if (fs::exists(fs::symlink_status(target))) {
    if (read_text_file(target, kMaxRootSize) == text) return;
    throw UsageError({.what = "the package carries another root of this version already",
                      .where = target,
                      .expected = "one root per version",
                      .found = root_file.string() + " with other bytes",
                      .fix = "find out which of the two is in use"});
  }
  fs::create_directories(target.parent_path());
  write_file_atomic(target, text);
}

}  // namespace nadir
