// Roots of trust that travel with a package, root/N.root.json. They are no artifacts: each carries its own signatures,
// and they may have to be read before the manifest's signature can be judged, because only they name its key.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "trust/aircraft_state.hpp"
#include "trust/root_walk.hpp"

namespace nadir {

inline constexpr std::string_view kRootFolder = "root";

std::string root_file_name(std::int64_t version);  // "root/2.root.json"

// Is this the name, relative to the package, of a root's file?
bool is_root_file_name(std::string_view relative_path);

// Walks from the trusted root through the roots that the aircraft remembers and those of the package. Besides the
// findings of walk_roots(): root.rollback for files beyond the newest root that can be reached.
RootWalk walk_package_roots(const std::filesystem::path& package, const TrustRoot& trusted, const AircraftState* state);

// Puts a root into the package. Throws UsageError for a file that is not signed by its own threshold or when another
// root of this version is there already.
void carry_root(const std::filesystem::path& package, const std::filesystem::path& root_file);

}  // namespace nadir
