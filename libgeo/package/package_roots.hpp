// Roots of trust that travel with a package, root/N.root.json. They are no artifacts: each carries its own signatures,
// and they may have to be read before the manifest's signature can be verified, because only they name its key.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <string_view>

#include "base/input_file.hpp"
#include "trust/aircraft_state.hpp"
#include "trust/root.hpp"

namespace nadir {

inline constexpr std::string_view kRootFolder = "root";

std::string root_file_name(std::int64_t version);  // "root/2.root.json"

// Is this the name, relative to the package, of a root's file?
bool is_root_file_name(std::string_view relative_path);

// Walks from the trusted root through the roots that the aircraft remembers and those of the package. Besides the
// findings of follow_root_chain(): root.rollback for files beyond the newest root that can be reached.
// at: when the package's roots are accepted; those that the aircraft remembers were accepted earlier.
RootSuccession walk_package_roots(const Directory& package, const TrustRoot& trusted, const AircraftState* state,
                                  UtcTime at);

// Documents of roots by version, each the successor of the one before.
using RootChain = std::map<std::int64_t, std::string>;

// The roots of these files, added to those that are there already. Throws UsageError for a file that is no root signed
// by its own threshold, for two of one version, and where a root is missing or is not signed by the one before it, be
// it because a key has expired by `at`; those that are there already may have been accepted by every aircraft before
// that. installed: the root that aircraft have, when it is known; then the chain must lead on from it.
RootChain read_root_chain(std::span<const std::filesystem::path> files, UtcTime at, RootChain already = {},
                          const TrustRoot* installed = nullptr);

// The roots in a package, unchecked.
RootChain roots_in_package(const Directory& package);

// Adds the roots to the package; those that it has already stay.
void add_package_roots(const std::filesystem::path& package, const RootChain& roots);

}  // namespace nadir
