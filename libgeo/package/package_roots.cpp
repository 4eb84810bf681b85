#include "package/package_roots.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

constexpr std::string_view kSuffix = ".root.json";
constexpr std::size_t kMaxDigits = 9;
constexpr std::size_t kMaxEntries = 10'000;

// The version in a file's name; 0 for other names.
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

std::optional<RootDocument> read_package_root(const Directory& package, std::int64_t version) {
  const std::string name = root_file_name(version);
  try {
    const std::optional<InputFile> file = package.find(name);
    if (!file) return std::nullopt;
    // Anything larger is not read at all; the empty text is then refused as an invalid root.
    if (file->size() > kMaxRootSize) return RootDocument{{}, name};
    return RootDocument{std::string(as_text(file->read(kMaxRootSize))), name};
  } catch (const Error&) {
    return std::nullopt;  // links and pipes are artifact.unexpected
  }
}

// By the files' names; their content is not read.
std::set<std::int64_t> root_versions_in(const Directory& package) {
  std::set<std::int64_t> versions;
  std::size_t entries = 0;
  package.walk([&](const Directory::Entry& entry) {
    if (is_root_file_name(entry.name)) versions.insert(version_of(entry.name.substr(kRootFolder.size() + 1)));
    return ++entries <= kMaxEntries;
  });
  return versions;
}

[[noreturn]] void refuse_chain(std::int64_t version, std::string expected, std::string found) {
  throw UsageError({.what = "aircraft cannot verify this chain of roots",
                    .where = fmt::format("root version {}", version),
                    .expected = std::move(expected),
                    .found = std::move(found),
                    .fix = "include every root after the one installed on the aircraft, each signed by the "
                           "root keys of its predecessor"});
}

void check_chain(const RootChain& chain, const std::set<std::int64_t>& added, UtcTime at, const TrustRoot* installed) {
  std::optional<TrustRoot> before;
  if (installed != nullptr) before = *installed;
  for (const auto& [version, text] : chain) {
    if (installed != nullptr && version <= installed->version) continue;
    SignedRoot next = parse_root(text, fmt::format("root version {}", version));
    if (next.root.version != version) {
      refuse_chain(version, fmt::format("version {}", version), fmt::format("version {}", next.root.version));
    }
    if (before) {
      const Findings findings =
          check_succession(*before, next, added.contains(version) ? std::optional(at) : std::nullopt);
      if (findings.has_errors()) {
        refuse_chain(version, findings.items().front().expected, findings.items().front().found);
      }
    }
    before = std::move(next.root);
  }
}

}  // namespace

std::string root_file_name(std::int64_t version) { return fmt::format("{}/{}{}", kRootFolder, version, kSuffix); }

bool is_root_file_name(std::string_view path) {
  return path.starts_with(kRootFolder) && path.size() > kRootFolder.size() && path[kRootFolder.size()] == '/' &&
         version_of(path.substr(kRootFolder.size() + 1)) > 0;
}

RootSuccession walk_package_roots(const Directory& package, const TrustRoot& trusted, const AircraftState* state,
                                  UtcTime at) {
  // What the aircraft remembers takes precedence over another root of the same version.
  RootSuccession walk = follow_root_chain(
      trusted,
      [&](std::int64_t version) -> std::optional<RootDocument> {
        if (state != nullptr) {
          const auto remembered = state->roots.find(version);
          if (remembered != state->roots.end()) {
            return RootDocument{remembered->second, fmt::format("the aircraft's state, root version {}", version),
                                true};
          }
        }
        return read_package_root(package, version);
      },
      at);
  const std::set<std::int64_t> versions = root_versions_in(package);
  const std::int64_t highest = versions.empty() ? 0 : *versions.rbegin();
  if (!walk.findings.has_errors() && highest > walk.root.version) {
    walk.findings.add({.code = "root.rollback",
                       .where = root_file_name(highest),
                       .expected = fmt::format("{}, the next version", root_file_name(walk.root.version + 1)),
                       .found = "only later versions",
                       .fix = "include the missing versions in the package"});
  }
  return walk;
}

RootChain read_root_chain(std::span<const fs::path> files, UtcTime at, RootChain already, const TrustRoot* installed) {
  RootChain chain = std::move(already);
  std::set<std::int64_t> added;
  for (const fs::path& file : files) {
    const std::string text = read_text_file(file, kMaxRootSize);
    const std::int64_t version = read_trusted_root(file).version;
    if (chain.emplace(version, text).second) {
      added.insert(version);
      continue;
    }
    if (chain.at(version) == text) continue;
    throw UsageError({.what = "two different roots have the same version",
                      .where = file,
                      .expected = fmt::format("one root of version {}", version),
                      .found = "a second one with different bytes",
                      .fix = "find out which of the two is in use"});
  }
  check_chain(chain, added, at, installed);
  return chain;
}

RootChain roots_in_package(const Directory& package) {
  RootChain chain;
  for (const std::int64_t version : root_versions_in(package)) {
    if (const auto document = read_package_root(package, version)) chain.emplace(version, document->text);
  }
  return chain;
}

void add_package_roots(const fs::path& package, const RootChain& roots) {
  if (!roots.empty()) fs::create_directories(package / kRootFolder);
  for (const auto& [version, text] : roots) {
    const fs::path target = package / root_file_name(version);
    if (!fs::exists(fs::symlink_status(target))) write_file_atomic(target, text);
  }
}

}  // namespace nadir
