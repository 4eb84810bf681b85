// nadir keys root: makes and signs a root of trust, the file that defines whose packages an aircraft trusts.
#include <fmt/format.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "commands/commands.hpp"
#include "commands/keys/root_signing.hpp"
#include "token_keys/token_key.hpp"
#include "trust/root.hpp"

namespace nadir {
namespace {

class KeysRootCommand final : public Command {
 public:
  std::string_view group() const override { return "keys"; }
  std::string_view name() const override { return "root"; }
  std::string_view summary() const override { return "create the root of trust: who may sign packages, until when"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  static void keep_signers(const TrustRoot& previous, TrustRoot& root);
  TrustRoot describe(const std::vector<PrivateKey>& root_keys, const std::optional<TrustRoot>& previous) const;

  std::vector<std::filesystem::path> root_keys_;
  std::vector<std::filesystem::path> previous_root_keys_;
  std::vector<std::filesystem::path> root_public_keys_;
  std::vector<std::filesystem::path> package_signers_;
  std::vector<std::filesystem::path> airframe_signers_;
  std::vector<std::string> tile_signers_;
  int threshold_ = 1;
  int root_threshold_ = 1;
  UtcTime expires_;
  bool incomplete_ = false, keep_signers_ = false;
  std::optional<std::filesystem::path> previous_;
  std::filesystem::path out_;
};

std::string_view KeysRootCommand::details() const {
  return R"(Without --previous this is version 1, which is installed on the aircraft by hand. With --previous it
is the next version, and must be signed by enough root keys of the previous one too: name those that
stay with --root-key and those that leave with --previous-root-key. Revocations carry over;
signers do not, unless --keep-signers is given: those that are left out are listed as warnings.

If the root keys are held by several people, name the keys of the others with --root-public-key and
write the root with --incomplete; each of them then runs `nadir keys sign`. No aircraft accepts it
before that.)";
}

std::string_view KeysRootCommand::examples() const {
  return R"(nadir keys root --root-key root.key.pem --package-signer planner.pub.pem --expires 2030-01-01 --out root.json
nadir keys root --root-key root.key.pem --package-signer new.pub.pem --expires 2032-01-01 --previous root.json --out 2.root.json
nadir keys root --root-key anna.key.pem --root-public-key ben.pub.pem --root-threshold 2 --package-signer planner.pub.pem --expires 2030-01-01 --incomplete --out root.json)";
}

void KeysRootCommand::setup(Options& options) {
  options.values("--root-key", root_keys_, "KEY.pem", "private root key; may be repeated").required();
  options.values("--root-public-key", root_public_keys_, "PUB.pem",
                 "root key whose owner signs elsewhere; may be repeated");
  options.values("--package-signer", package_signers_, "PUB.pem", "public key that may sign packages").required();
  options.values("--tile-signer", tile_signers_, "AIRFRAME=PUB.pem",
                 "public key with which an airframe signs the tiles it makes");
  options.values("--airframe-signer", airframe_signers_, "PUB.pem",
                 "public key that may sign airframe files; with one, aircraft reject unsigned airframe files");
  options.value("--threshold", threshold_, "N", "number of package signers that must sign a package").between(1, 32);
  options.value("--root-threshold", root_threshold_, "N", "number of root keys that must sign the next root")
      .between(1, 32);
  options.value("--expires", expires_, "DATE", "end of validity").required();
  options.value("--previous", previous_, "ROOT.json", "root that this one succeeds");
  options
      .values("--previous-root-key", previous_root_keys_, "KEY.pem",
              "private key of the previous root that is not a key of the new one")
      .needs("--previous");
  options
      .flag("--keep-signers", keep_signers_,
            "keep all signers of the previous root that are not revoked, beside those named here")
      .needs("--previous");
  options.flag("--incomplete", incomplete_, "write the root although more root keys must sign it");
  options.value("--out", out_, "ROOT.json", "root file to create").required();
}

TrustRoot KeysRootCommand::describe(const std::vector<PrivateKey>& root_keys,
                                    const std::optional<TrustRoot>& previous) const {
  TrustRoot root;
  if (previous) {
    root.version = previous->version + 1;
    root.revoked = previous->revoked;
    if (keep_signers_) keep_signers(*previous, root);
  }
  root.expires = expires_;
  const auto check_threshold = [](const Role& role, const char* option, const char* keys) {
    if (role.threshold <= role.key_ids.size()) return;
    throw UsageError({.what = fmt::format("{} requires more signatures than there are keys", option),
                      .expected = fmt::format("at most {}, the number of different {}", role.key_ids.size(), keys),
                      .found = std::to_string(role.threshold)});
  };
  for (const PrivateKey& key : root_keys) give_role(root, root.root, key.public_key());
  for (const auto& path : root_public_keys_) give_role(root, root.root, PublicKey::read(path));
  root.root.threshold = static_cast<std::uint32_t>(root_threshold_);
  check_threshold(root.root, "--root-threshold", "--root-key and --root-public-key");
  for (const auto& path : package_signers_) give_role(root, root.package_signer, PublicKey::read(path));
  root.package_signer.threshold = static_cast<std::uint32_t>(threshold_);
  check_threshold(root.package_signer, "--threshold", "--package-signer");
  if (!airframe_signers_.empty() && !root.airframe_signer) root.airframe_signer.emplace();
  for (const auto& path : airframe_signers_) give_role(root, *root.airframe_signer, PublicKey::read(path));
  for (const std::string& signer : tile_signers_) {
    const std::size_t equals = signer.find('=');
    if (equals == std::string::npos || equals == 0 || equals + 1 == signer.size()) {
      throw UsageError({.what = "--tile-signer names no airframe and key",
                        .expected = "AIRFRAME=PUB.pem, such as mini-07=tiles.pub.pem",
                        .found = signer});
    }
    give_role(root, root.tile_signers[signer.substr(0, equals)], PublicKey::read(signer.substr(equals + 1)));
  }
  return root;
}

void KeysRootCommand::keep_signers(const TrustRoot& previous, TrustRoot& root) {
  const auto kept = [&](const Role& before) {
    Role now;
    for (const std::string& id : before.key_ids) {
      if (root.revoked.contains(id)) continue;
      root.keys.emplace(id, previous.keys.at(id));  // with the expiry of the key itself
      now.key_ids.insert(id);
    }
    return now;
  };
  root.package_signer = kept(previous.package_signer);
  if (previous.airframe_signer) root.airframe_signer = kept(*previous.airframe_signer);
  for (const auto& [airframe, role] : previous.tile_signers) {
    if (Role tiles = kept(role); !tiles.key_ids.empty()) root.tile_signers[airframe] = std::move(tiles);
  }
}

int KeysRootCommand::run(Context& context) {
  check_new_root(out_, expires_, context.clock);
  std::optional<TrustRoot> previous;
  if (previous_) previous = read_trusted_root(*previous_);
  std::vector<PrivateKey> keys = read_private_keys(root_keys_);
  TrustRoot root = describe(keys, previous);
  for (const auto& path : previous_root_keys_) keys.push_back(read_signing_key(path));
  return write_new_root(context, {std::move(root), std::move(previous), out_, incomplete_}, keys);
}

}  // namespace

std::unique_ptr<Command> make_keys_root() { return std::make_unique<KeysRootCommand>(); }

}  // namespace nadir
