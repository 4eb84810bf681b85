// nadir keys sign: one more signature for a root of trust or a permit, so that several people can sign it.
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
#include "trust/time_permit.hpp"

namespace nadir {
namespace {

void require_key(bool known, const PrivateKey& key, const char* role) {
  if (known) return;
  throw UsageError({.what = "a signature by this key would have no effect",
                    .expected = role,
                    .found = "key " + key.public_key().id(),
                    .fix = "sign with a key that has the role"});
}

class KeysSignCommand final : public Command {
 public:
  std::string_view group() const override { return "keys"; }
  std::string_view name() const override { return "sign"; }
  std::string_view summary() const override { return "add a signature to a root of trust or a permit"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  Findings sign_root_file(const std::string& text, const std::vector<PrivateKey>& keys, UtcTime at,
                          std::string& result) const;
  Findings sign_permit_file(SignedDocument permit, std::string_view payload_type, const std::vector<PrivateKey>& keys,
                            UtcTime at, std::string& result) const;

  std::filesystem::path file_;
  std::vector<std::filesystem::path> keys_;
  std::optional<std::filesystem::path> previous_;
  std::optional<std::filesystem::path> trust_;
};

std::string_view KeysSignCommand::details() const {
  return R"(The file is replaced in one step; a key that has already signed is not counted twice. Review the
file before you sign: it is readable JSON. A new version of a root is signed by the previous root's
keys too: name that root with --previous. A permit is checked against --trust.

Exit codes: 0 signed ("complete" states whether the signatures suffice), 2 not signed.)";
}

std::string_view KeysSignCommand::examples() const {
  return R"(nadir keys sign root.json --key ben.key.pem
nadir keys sign 2.root.json --key ben.key.pem --previous root.json
nadir keys sign permit.json --key ben.key.pem --trust root.json)";
}

void KeysSignCommand::setup(Options& options) {
  options.positional("FILE.json", file_, "root of trust or permit").required();
  options.values("--key", keys_, "KEY.pem", "private key (file or pkcs11: URI) that signs; may be repeated").required();
  options.value("--previous", previous_, "ROOT.json", "for a root: its predecessor");
  options.value("--trust", trust_, "ROOT.json", "for a permit: root that names the package signers");
}

Findings KeysSignCommand::sign_root_file(const std::string& text, const std::vector<PrivateKey>& keys, UtcTime at,
                                         std::string& result) const {
  SignedRoot root = parse_root(text, file_.string());
  std::optional<TrustRoot> previous;
  if (previous_) previous = read_trusted_root(*previous_);
  for (const PrivateKey& key : keys) {
    const std::string id = key.public_key().id();
    require_key(root.root.root.key_ids.contains(id) || (previous && previous->root.key_ids.contains(id)), key,
                "a root key of this root or of its predecessor (--previous)");
    add_signature(root, key);
  }
  result = root.json();
  if (previous) return check_succession(*previous, root, at);
  Findings findings = check_self(root);
  if (root.root.version > 1) {
    findings.add({.code = "signature.missing",
                  .where = file_.string(),
                  .expected = "its predecessor, whose keys must sign as well",
                  .found = "none given",
                  .fix = "name it with --previous"});
  }
  return findings;
}

Findings KeysSignCommand::sign_permit_file(SignedDocument permit, std::string_view payload_type,
                                           const std::vector<PrivateKey>& keys, UtcTime at, std::string& result) const {
  if (!trust_)
    throw UsageError({.what = "without a root it is unknown who may sign a permit",
                      .expected = "the root that names the package signers",
                      .found = "no --trust",
                      .fix = "name it with --trust ROOT.json"});
  const TrustRoot root = read_trusted_root(*trust_);
  for (const PrivateKey& key : keys) {
    require_key(root.package_signer.key_ids.contains(key.public_key().id()), key, "a package signer of the root");
    permit.put(sign_payload(key, payload_type, as_bytes(permit.signed_bytes)));
  }
  result = permit.json();
  return check_signatures(root, root.package_signer, permit.signatures, payload_type, as_bytes(permit.signed_bytes), at,
                          file_.string())
      .findings;
}

int KeysSignCommand::run(Context& context) {
  const std::string text = read_text_file(file_, kMaxRootSize);
  const std::vector<PrivateKey> keys = read_private_keys(keys_);
  const std::string schema = claimed_schema(text, file_.string());
  const UtcTime now = context.clock.now();
  std::string result;
  Findings missing;
  if (schema == kRootSchema) {
    missing = sign_root_file(text, keys, now, result);
  } else if (schema == kPermitSchema) {
    missing = sign_permit_file(parse_permit(text, file_.string()).document, kPermitPayloadType, keys, now, result);
  } else if (schema == kTimePermitSchema) {
    missing =
        sign_permit_file(parse_time_permit(text, file_.string()).document, kTimePermitPayloadType, keys, now, result);
  } else {
    throw UsageError({.what = "this file cannot be signed with this command",
                      .where = file_,
                      .expected = "a root of trust or a permit",
                      .found = schema.empty() ? "another kind of document" : "schema " + schema.substr(0, 80),
                      .fix = "packages are signed with `nadir cache sign`"});
  }
  write_file_atomic(file_, result);
  const bool complete = !missing.has_errors();
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
