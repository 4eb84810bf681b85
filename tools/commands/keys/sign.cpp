// nadir keys sign: one more signature for a root of trust or a rollback permit, so that several people can sign it.
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "commands/keys/root_signing.hpp"
#include "trust/rollback_permit.hpp"
#include "trust/root.hpp"
#include "trust/signatures.hpp"

namespace nadir {
namespace {

void require_key(bool known, const PrivateKey& key, const char* role) {
  if (known) return;
  throw UsageError({.what = "a signature by this key would count for nothing",
                    .expected = role,
                    .found = "key " + key.public_key().id(),
                    .fix = "sign with a key that has the role"});
}

class KeysSignCommand final : public Command {
 public:
  std::string_view group() const override { return "keys"; }
  std::string_view name() const override { return "sign"; }
  std::string_view summary() const override { return "add a signature to a root or to a rollback permit"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  Findings sign_root_file(const std::string& text, const std::vector<PrivateKey>& keys, std::string& result) const;
  Findings sign_permit_file(const std::string& text, const std::vector<PrivateKey>& keys, UtcTime at,
                            std::string& result) const;

  std::filesystem::path file_;
  std::vector<std::filesystem::path> keys_;
  std::optional<std::filesystem::path> previous_;
  std::optional<std::filesystem::path> trust_;
};

std::string_view KeysSignCommand::details() const {
  return "The file is replaced in one step; a key that has signed before is not counted twice. Whoever signs should\n"
         "look at the file first: it is readable JSON. A new version of a root is signed by the previous root's keys\n"
         "too: name that root with --previous. A permit is held against --trust.\n\n"
         "Exit codes: 0 signed (\"complete\" says whether that is enough), 2 could not be signed.";
}

std::string_view KeysSignCommand::examples() const {
  return "nadir keys sign root.json --key ben.key.pem\n"
         "nadir keys sign 2.root.json --key ben.key.pem --previous root.json\n"
         "nadir keys sign permit.json --key ben.key.pem --trust root.json";
}

void KeysSignCommand::setup(Options& options) {
  options.positional("FILE.json", file_, "root of trust or rollback permit").required();
  options.values("--key", keys_, "KEY.pem", "private key that signs; may be given several times").required();
  options.value("--previous", previous_, "ROOT.json", "for a root: the one that it follows");
  options.value("--trust", trust_, "ROOT.json", "for a permit: the root that names the package signers");
}

Findings KeysSignCommand::sign_root_file(const std::string& text, const std::vector<PrivateKey>& keys,
                                         std::string& result) const {
  SignedRoot root = parse_root(text, file_.string());
  std::optional<TrustRoot> previous;
  if (previous_) previous = read_trusted_root(*previous_);
  for (const PrivateKey& key : keys) {
    const std::string id = key.public_key().id();
    require_key(root.root.root.key_ids.contains(id) || (previous && previous->root.key_ids.contains(id)), key,
                "a root key of this root, or of the one before it (--previous)");
    add_signature(root, key);
  }
  result = root.json();
  if (previous) return check_succession(*previous, root);
  Findings findings = check_self(root);
  if (root.root.version > 1) {
    findings.add({.code = "signature.missing",
                  .where = file_.string(),
                  .expected = "the root before it, to count its keys' signatures as well",
                  .found = "none given",
                  .fix = "name it with --previous"});
  }
  return findings;
}

Findings KeysSignCommand::sign_permit_file(const std::string& text, const std::vector<PrivateKey>& keys, UtcTime at,
                                           std::string& result) const {
  if (!trust_) throw UsageError({.what = "a permit is signed by package signers", .expected = "--trust ROOT.json"});
  const TrustRoot root = read_trusted_root(*trust_);
  SignedPermit permit = parse_permit(text, file_.string());
  for (const PrivateKey& key : keys) {
    require_key(root.package_signer.key_ids.contains(key.public_key().id()), key, "a package signer of the root");
    permit.document.put(sign_payload(key, kPermitPayloadType, as_bytes(permit.document.signed_bytes)));
  }
  result = permit.document.json();
  return check_signatures(root, root.package_signer, permit.document.signatures, kPermitPayloadType,
                          as_bytes(permit.document.signed_bytes), at, file_.string())
      .findings;
}

int KeysSignCommand::run(Context& context) {
  const std::string text = read_text_file(file_, kMaxRootSize);
  const std::vector<PrivateKey> keys = read_private_keys(keys_);
  const std::string schema = claimed_schema(text, file_.string());
  std::string result;
  Findings missing;
  if (schema == kRootSchema) {
    missing = sign_root_file(text, keys, result);
  } else if (schema == kPermitSchema) {
    missing = sign_permit_file(text, keys, context.clock.now(), result);
  } else {
    throw UsageError({.what = "this file cannot be signed here",
                      .where = file_,
                      .expected = "a root of trust or a rollback permit",
                      .found = schema.empty() ? "another document" : "schema " + schema.substr(0, 80),
                      .fix = "packages are signed with `nadir cache sign`"});
  }
  write_file_atomic(file_, result);
  const bool complete = !missing.refuses();
  if (context.json) {
    print_json(context.out, {{"file", file_.string()}, {"complete", complete}});
    return kAccepted;
  }
  print_figures(context.out, {{"signed", file_.string()}, {"complete", complete ? "yes" : "no"}});
  if (!complete && !context.quiet) print_findings(context.err, missing);
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_keys_sign() { return std::make_unique<KeysSignCommand>(); }

}  // namespace nadir
