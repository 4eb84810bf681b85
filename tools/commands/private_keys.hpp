// The private keys that a command is given, for several signers of one document.
#pragma once

#include <filesystem>
#include <span>
#include <vector>

#include "trust/keys.hpp"

namespace nadir {

std::vector<PrivateKey> read_private_keys(std::span<const std::filesystem::path> files);

// For functions that sign with some of them; they must outlive the result.
std::vector<const PrivateKey*> pointers_to(const std::vector<PrivateKey>& keys);

}  // namespace nadir
