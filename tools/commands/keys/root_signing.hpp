// The private keys that a command is given, for several signers of one document.
//
// What the commands that make roots of trust share: a root is written only when aircraft will accept it, or when it is
// meant to be signed by others first.
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "cli/command.hpp"
#include "trust/keys.hpp"
#include "trust/root.hpp"

namespace nadir {

std::vector<PrivateKey> read_private_keys(std::span<const std::filesystem::path> files);

// For functions that sign with some of them; they must outlive the result.
std::vector<const PrivateKey*> pointers_to(const std::vector<PrivateKey>& keys);

struct NewRoot {
  TrustRoot root;
  std::optional<TrustRoot> previous;
  std::filesystem::path out;
  bool incomplete = false;  // others sign later, with `nadir keys sign`
};

// Throws UsageError when the output exists or the date is past. For before the keys are read.
void check_new_root(const std::filesystem::path& out, UtcTime expires, const Clock& clock);

// A clock that shows less is wrong: nothing of this kind existed before. Machines without a battery-backed clock start
// in 1970.
inline constexpr UtcTime kEarliestNow{1'704'067'200};  // 2024-01-01

// Throws UsageError when the end of validity has passed, or the clock cannot be right.
void check_expires(UtcTime expires, const Clock& clock);

// Signs, checks as an aircraft does, writes and prints. Throws UsageError when signatures are missing, unless the root
// may be incomplete.
int write_new_root(Context& context, NewRoot wanted, const std::vector<PrivateKey>& signers);

// Adds the key to the root and to the role.
void give_role(TrustRoot& root, Role& role, const PublicKey& key);

}  // namespace nadir
