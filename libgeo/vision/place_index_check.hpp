// Is the place index of a package the one that its imagery gives? package/verify.hpp has checked the files' bytes; what
// they mean can only be judged here, with the descriptor at hand.
#pragma once

#include <filesystem>

#include "base/error.hpp"
#include "base/progress.hpp"
#include "package/open_package.hpp"
#include "package/verify.hpp"

namespace nadir {

// "index.mismatch": the table does not read, is for other imagery or another plane, or does not fit the vectors; at
// full depth also when a sample of the chunks (one in a hundred, 32 at least, drawn by the manifest's digest) is
// described anew from the tiles and comes out differently. Nothing for a package without an index.
Findings check_place_index(const std::filesystem::path& package, const Manifest& manifest, const Mission& mission,
                           const TileSource& tiles, VerifyDepth depth, Progress& progress);

// What every command adds to verify_package() and open_package().
void verify_place_index(const std::filesystem::path& package, VerifyDepth depth, Progress& progress,
                        Verification& verification);
void verify_place_index(const std::filesystem::path& package, VerifyDepth depth, Progress& progress, Opening& opening);

}  // namespace nadir
