// May this key sign packages? Asked before anything is signed with it.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "cli/command.hpp"
#include "trust/keys.hpp"
#include "trust/root.hpp"

namespace nadir {

// With a root: throws UsageError for a key that is no package signer of it, is revoked or has expired. Roots that the
// package carries may appoint it later; then it is a note. Without a root: a note that nobody checked.
void require_package_signer(const PrivateKey& key, const std::optional<TrustRoot>& root,
                            const std::vector<std::filesystem::path>& carried, Context& context);

}  // namespace nadir
