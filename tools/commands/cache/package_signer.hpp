// Who signs a package that is made, and whether that key may: asked before anything is made.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "cli/command.hpp"
#include "package/package_roots.hpp"
#include "trust/keys.hpp"
#include "trust/root.hpp"

namespace nadir {

class Options;

// With a root: throws UsageError for a key that is no package signer of it, is revoked or has expired. Roots that the
// package carries may appoint it later; then it is a note. Without a root: a note that nobody checked.
void require_package_signer(const PrivateKey& key, const std::optional<TrustRoot>& root,
                            const std::vector<std::filesystem::path>& carried, Context& context);

// The options of commands that make a package: --key, --carry-root and --trust.
class SigningOptions {
 public:
  void setup(Options& options);

  struct Signing {
    std::optional<PrivateKey> key;
    RootChain roots;  // to be added to the package
  };
  // at: when carried roots must be valid. Throws UsageError as require_package_signer() does.
  Signing read(UtcTime at, Context& context) const;

 private:
  std::optional<std::filesystem::path> key_;
  std::vector<std::filesystem::path> roots_;
  std::optional<std::filesystem::path> trust_;
};

}  // namespace nadir
