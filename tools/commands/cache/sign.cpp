// nadir cache sign: signs a package that was built without a key, or adds a second signature.
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/cache/package_signer.hpp"
#include "commands/commands.hpp"
#include "commands/keys/root_signing.hpp"
#include "package/package_roots.hpp"
#include "package/package_writer.hpp"
#include "package/verify.hpp"

namespace nadir {
namespace {

class CacheSignCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "sign"; }
  std::string_view summary() const override { return "sign a package, or add a signature to it"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path package_;
  std::vector<std::filesystem::path> keys_;
  std::vector<std::filesystem::path> roots_;
  bool only_ = false;
  std::optional<std::filesystem::path> trust_;
};

std::string_view CacheSignCommand::details() const {
  return R"(Every file is hashed first: a package that does not match its manifest is not signed (exit code 1).
Signatures by other keys stay, which is how a threshold of two or more is met; --only drops them.
The manifest does not change.

--carry-root adds a newer root of trust to the package, so that an aircraft that holds its
predecessor learns of new and revoked keys.)";
}

std::string_view CacheSignCommand::examples() const {
  return R"(nadir cache sign package --key planner.key.pem
nadir cache sign package --key planner2.key.pem --carry-root 2.root.json)";
}

void CacheSignCommand::setup(Options& options) {
  options.positional("PACKAGE", package_, "package folder").required();
  options.values("--key", keys_, "KEY.pem", "private key (file or pkcs11: URI) of a package signer; may be repeated")
      .required();
  options.values("--carry-root", roots_, "N.root.json", "newer root of trust to add to the package");
  options.flag("--only", only_, "drop existing signatures");
  options.value("--trust", trust_, "ROOT.json", "root that the aircraft hold: the keys must be package signers of it");
}

int CacheSignCommand::run(Context& context) {
  if (!std::filesystem::is_regular_file(std::filesystem::symlink_status(package_ / kManifestFile))) {
    throw UsageError({.what = "this is not a mission package",
                      .where = package_,
                      .expected = "a folder with manifest.json",
                      .found = "none",
                      .fix = "give the folder that `nadir cache build --out` created"});
  }
  const std::vector<PrivateKey> keys = read_private_keys(keys_);
  std::optional<TrustRoot> installed;
  if (trust_) installed = read_trusted_root(*trust_);
  for (const PrivateKey& key : keys) require_package_signer(key, installed, roots_, context);
  const Findings findings = check_before_signing(package_, context.progress);
  if (findings.has_errors()) return report_findings(context.out, context.json, findings);

  add_package_roots(package_, read_root_chain(roots_, context.clock.now(), roots_in_package(Directory(package_))));
  std::size_t signatures = 0;
  bool only = only_;
  for (const PrivateKey& key : keys) {
    if (only) {
      sign_package(package_, key);
      signatures = 1;
      only = false;
    } else {
      signatures = add_package_signature(package_, key);
    }
  }
  nlohmann::json more{{"package", package_.string()}, {"signatures", signatures}, {"keyids", nlohmann::json::array()}};
  Figures figures{{"package", package_.string()}, {"signatures", std::to_string(signatures)}};
  for (const PrivateKey& key : keys) {
    more["keyids"].push_back(key.public_key().id());
    figures.emplace_back("signed by", key.public_key().id());
  }
  if (context.json) return report_findings(context.out, true, findings, more);
  print_figures(context.out, figures);
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_cache_sign() { return std::make_unique<CacheSignCommand>(); }

}  // namespace nadir
