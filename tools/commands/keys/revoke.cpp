// nadir keys revoke: the next root of trust, in which a key counts for nothing any more.
#include <fmt/format.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "commands/commands.hpp"
#include "commands/keys/root_signing.hpp"
#include "token_keys/token_key.hpp"
#include "trust/root.hpp"

namespace nadir {
namespace {

std::string key_id(const std::string& id_or_file) {
  return Sha256::from_hex(id_or_file) ? id_or_file : PublicKey::read(id_or_file).id();
}

void require_threshold(const Role& role, const std::string& name, const char* fix) {
  if (role.threshold <= role.key_ids.size()) return;
  throw UsageError({.what = fmt::format("without the revoked keys, role {} has too few keys", name),
                    .expected = fmt::format("at least {} keys", role.threshold),
                    .found = fmt::format("{} keys", role.key_ids.size()),
                    .fix = fix});
}

// Takes the key out of every role. An airframe that had no other key has no tile signer any more.
void revoke(TrustRoot& root, const std::string& id) {
  if (root.revoked.contains(id))
    throw UsageError({.what = "this key is already revoked",
                      .where = "--revoke",
                      .expected = "a key that the previous root still trusts",
                      .found = "key " + id,
                      .fix = "leave it out of --revoke"});
  if (root.keys.erase(id) == 0) {
    throw UsageError({.what = "the root does not contain this key",
                      .expected = "a key with a role in the root",
                      .found = "key " + id,
                      .fix = "check --revoke and --previous"});
  }
  root.revoked.insert(id);
  root.root.key_ids.erase(id);
  root.package_signer.key_ids.erase(id);
  if (root.airframe_signer) root.airframe_signer->key_ids.erase(id);
  for (auto signer = root.tile_signers.begin(); signer != root.tile_signers.end();) {
    signer->second.key_ids.erase(id);
    signer = signer->second.key_ids.empty() ? root.tile_signers.erase(signer) : std::next(signer);
  }
}

class KeysRevokeCommand final : public Command {
 public:
  std::string_view group() const override { return "keys"; }
  std::string_view name() const override { return "revoke"; }
  std::string_view summary() const override { return "create the next root, with keys revoked"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path previous_;
  std::vector<std::string> revoked_;
  std::vector<std::filesystem::path> root_keys_;
  std::vector<std::filesystem::path> new_root_keys_;
  std::vector<std::filesystem::path> new_package_signers_;
  std::vector<std::filesystem::path> new_airframe_signers_;
  std::optional<UtcTime> expires_;
  bool incomplete_ = false;
  std::filesystem::path out_;
};

std::string_view KeysRevokeCommand::details() const {
  return R"(Everything else stays as in the previous root. The new root must be signed by enough root keys of
both (--root-key), and a revoked key that was the last of its role must be replaced
(--new-root-key, --new-package-signer, --new-airframe-signer). Aircraft learn of it with their next
package: nadir cache sign --carry-root.)";
}

std::string_view KeysRevokeCommand::examples() const {
  return R"(nadir keys revoke --previous root.json --revoke lost.pub.pem --new-package-signer planner2.pub.pem --root-key root.key.pem --out 2.root.json)";
}

void KeysRevokeCommand::setup(Options& options) {
  options.value("--previous", previous_, "ROOT.json", "root that this one succeeds").required();
  options.values("--revoke", revoked_, "PUB.pem|KEYID", "compromised or lost key; may be repeated").required();
  options
      .values("--root-key", root_keys_, "KEY.pem",
              "private root key of the previous or of the new root; may be repeated")
      .required();
  options.values("--new-root-key", new_root_keys_, "KEY.pem", "private key to add to the root keys; it signs as well");
  options.values("--new-package-signer", new_package_signers_, "PUB.pem", "public key to add to the package signers");
  options.values("--new-airframe-signer", new_airframe_signers_, "PUB.pem",
                 "public key to add to the airframe signers");
  options.value("--expires", expires_, "DATE", "end of validity; default: as the previous root");
  options.flag("--incomplete", incomplete_, "write the root although more root keys must sign it");
  options.value("--out", out_, "ROOT.json", "root file to create").required();
}

int KeysRevokeCommand::run(Context& context) {
  const TrustRoot previous = read_trusted_root(previous_);
  TrustRoot root = previous;
  ++root.version;
  root.expires = expires_.value_or(previous.expires);
  check_new_root(out_, root.expires, context.clock);
  for (const std::string& key : revoked_) revoke(root, key_id(key));

  std::vector<PrivateKey> keys;
  for (const auto& path : new_root_keys_) {
    keys.push_back(read_signing_key(path));
    give_role(root, root.root, keys.back().public_key());
  }
  for (const auto& path : new_package_signers_) give_role(root, root.package_signer, PublicKey::read(path));
  for (const auto& path : new_airframe_signers_) {
    if (!root.airframe_signer) root.airframe_signer.emplace();
    give_role(root, *root.airframe_signer, PublicKey::read(path));
  }
  for (const auto& [id, key] : root.keys) {
    if (!root.revoked.contains(id)) continue;
    throw UsageError({.what = "a revoked key cannot be added again",
                      .found = "key " + id,
                      .fix = "create a new key: nadir keys create"});
  }
  require_threshold(root.root, "root", "add a replacement with --new-root-key");
  require_threshold(root.package_signer, "package-signer", "add a replacement with --new-package-signer");
  if (root.airframe_signer) {  // without the role unsigned airframes would be accepted again
    require_threshold(*root.airframe_signer, "airframe-signer", "add a replacement with --new-airframe-signer");
  }
  for (const auto& [airframe, role] : root.tile_signers) {
    require_threshold(role, "tile-signer of " + airframe,
                      "create the next root from scratch: nadir keys root --previous");
  }
  for (const auto& path : root_keys_) {
    keys.push_back(read_signing_key(path));
    const std::string id = keys.back().public_key().id();
    if (previous.root.key_ids.contains(id) || root.root.key_ids.contains(id)) continue;
    throw UsageError({.what = "a signature by this key would have no effect",
                      .where = path,
                      .expected = "a root key of the previous or of the new root",
                      .found = "key " + id,
                      .fix = "check --root-key; a new root key is added with --new-root-key"});
  }
  return write_new_root(context, {std::move(root), previous, out_, incomplete_}, keys);
}

}  // namespace

std::unique_ptr<Command> make_keys_revoke() { return std::make_unique<KeysRevokeCommand>(); }

}  // namespace nadir
