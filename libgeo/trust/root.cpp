#include "trust/root.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/json.hpp"
#include "trust/signatures.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxKeyIds = 1024;
constexpr std::uint32_t kMaxThreshold = 32;
constexpr std::int64_t kMaxVersion = std::int64_t{1} << 31;
constexpr int kMaxChain = 256;  // more roots than an aircraft sees in its life
constexpr const char* kExpiredRootKey =
    "if the clock is right, let root keys sign that have not expired; where too few are left, install the newest root "
    "by "
    "hand";

std::set<std::string> read_key_ids(const JsonReader& in, const char* name) {
  const JsonReader list = in.array(name, {.most = kMaxKeyIds});
  std::set<std::string> ids;
  for (std::size_t i = 0; i < list.size(); ++i) {
    if (!ids.insert(list.digest(i).hex()).second) list.refuse(i, "each key once");
  }
  return ids;
}

TrustedKey read_key(const JsonReader& in, const std::string& id) {
  in.expect("algorithm", "ed25519");
  const auto raw = from_base64(in.text("public"));
  if (!raw || raw->size() != 32) in.refuse("public", "32 bytes in base64");
  TrustedKey trusted{PublicKey::from_raw(*raw), in.optional_time("expires")};
  if (trusted.key.id() != id) in.refuse("public", "the key of which this is the id");
  in.finish();
  return trusted;
}

Role read_role(const JsonReader& in, const TrustRoot& root) {
  Role role;
  role.key_ids = read_key_ids(in, "keyids");
  for (const std::string& id : role.key_ids) {
    if (!root.keys.contains(id)) in.refuse("keyids", "keys that are listed in \"keys\"", id);
  }
  const std::size_t most = std::min<std::size_t>(role.key_ids.size(), kMaxThreshold);  // so it needs one key at least
  role.threshold = in.integer<std::uint32_t>("threshold", 1, static_cast<std::uint32_t>(most));
  in.finish();
  return role;
}

TrustRoot read_root(const JsonReader& in) {
  in.expect("schema", kRootSchema);
  TrustRoot root;
  root.version = in.integer("version", 1, kMaxVersion);
  root.expires = in.time("expires");
  const JsonReader keys = in.object("keys");
  for (const std::string& id : keys.keys()) root.keys.emplace(id, read_key(keys.object(id), id));
  const JsonReader roles = in.object("roles");
  root.root = read_role(roles.object("root"), root);
  root.package_signer = read_role(roles.object("package-signer"), root);
  if (const auto signers = roles.optional_object("tile-signer")) {
    for (const std::string& airframe : signers->keys()) {
      root.tile_signers.emplace(airframe, read_role(signers->object(airframe), root));
    }
  }
  if (const auto signers = roles.optional_object("airframe-signer")) {
    root.airframe_signer = read_role(*signers, root);
  }
  roles.finish();
  root.revoked = read_key_ids(in, "revoked");
  in.finish();
  return root;
}

json to_json(const Role& role) { return {{"keyids", role.key_ids}, {"threshold", role.threshold}}; }

json to_json(const TrustRoot& root) {
  json keys = json::object();
  for (const auto& [id, trusted] : root.keys) {
    keys[id] = {{"algorithm", "ed25519"}, {"public", to_base64(trusted.key.raw())}};
    if (trusted.expires) keys[id]["expires"] = to_rfc3339(*trusted.expires);
  }
  json roles{{"root", to_json(root.root)}, {"package-signer", to_json(root.package_signer)}};
  for (const auto& [airframe, role] : root.tile_signers) roles["tile-signer"][airframe] = to_json(role);
  if (root.airframe_signer) roles["airframe-signer"] = to_json(*root.airframe_signer);
  return {{"schema", kRootSchema}, {"version", root.version}, {"expires", to_rfc3339(root.expires)},
          {"keys", keys},          {"roles", roles},          {"revoked", root.revoked}};
}

}  // namespace

void TrustRoot::add_key(const PublicKey& key) { keys.insert_or_assign(key.id(), TrustedKey{key, std::nullopt}); }

SignedRoot sign_root(TrustRoot root, const std::vector<const PrivateKey*>& keys) {
  SignedRoot result;
  result.signed_bytes = to_json(root).dump();
  for (const PrivateKey* key : keys) add_signature(result, *key);
  result.root = std::move(root);
  // A root that a reader would reject must not leave this function.
  return parse_root(result.json(), "the new trust root");
}

void add_signature(SignedRoot& root, const PrivateKey& key) {
  put_signature(root.signatures, sign_payload(key, kRootPayloadType, as_bytes(root.signed_bytes)));
}

std::string SignedRoot::json() const { return SignedDocument{signed_bytes, signatures}.json(); }

SignedRoot parse_root(std::string_view text, std::string_view name) {
  const json document = parse_json(text, name, {.max_depth = 8, .allow_floats = false});
  const SignedDocument parts = split_signed_document(document, name);
  const JsonReader in(document, {.name = std::string(name), .what = "cannot accept this trust root"});
  return {read_root(in.object("signed")), parts.signatures, parts.signed_bytes};
}

TrustRoot read_trusted_root(const std::filesystem::path& path) {
  SignedRoot file = parse_root(read_text_file(path, kMaxRootSize), path.string());
  const Findings findings = check_self(file);
  if (findings.has_errors()) {
    const Finding& first = findings.items().front();
    throw Error({.what = "this trust root is not signed by its own keys",
                 .where = path,
                 .expected = first.expected,
                 .found = first.found,
                 .fix = "get the root again from those who made it; an edited root loses its signatures"});
  }
  return std::move(file.root);
}

Findings check_self(const SignedRoot& root) {
  return check_signatures(root.root, root.root.root, root.signatures, kRootPayloadType, as_bytes(root.signed_bytes),
                          std::nullopt, fmt::format("root version {}", root.root.version))
      .findings;
}

Findings check_succession(const TrustRoot& trusted, const SignedRoot& next, std::optional<UtcTime> at) {
  const std::string where = fmt::format("root version {}", next.root.version);
  Findings findings;
  if (next.root.version != trusted.version + 1) {
    findings.add({.code = "root.rollback",
                  .where = where,
                  .expected = fmt::format("version {}", trusted.version + 1),
                  .found = fmt::format("version {}", next.root.version),
                  .fix = "provide the roots between them as well, in order"});
  }
  // Each side counts its own keys: ignore signatures of the other side's keys.
  const auto by_role = [&](const TrustRoot& trust, const Role& role) {
    std::vector<EnvelopeSignature> own;
    for (const EnvelopeSignature& signature : next.signatures) {
      if (role.key_ids.contains(signature.keyid)) own.push_back(signature);
    }
    const SignatureCheck check =
        check_signatures(trust, role, own, kRootPayloadType, as_bytes(next.signed_bytes), at, where);
    for (Finding finding : check.findings.items()) {
      if (finding.code == "key.expired") finding.fix = kExpiredRootKey;
      findings.add(std::move(finding));
    }
  };
  by_role(trusted, trusted.root);
  by_role(next.root, next.root.root);
  return findings;
}

RootSuccession follow_root_chain(TrustRoot trusted, const RootLookup& find, UtcTime at) {
  RootSuccession chain{std::move(trusted), {}, {}};
  for (int step = 0; step < kMaxChain; ++step) {
    const auto document = find(chain.root.version + 1);
    if (!document) break;
    try {
      SignedRoot next = parse_root(document->text, document->where);
      const Findings findings =
          check_succession(chain.root, next, document->accepted_earlier ? std::nullopt : std::optional(at));
      chain.findings.add(findings);
      if (findings.has_errors()) break;
      chain.root = std::move(next.root);
      chain.newer.emplace(chain.root.version, document->text);
    } catch (const Error& error) {
      chain.findings.add({.code = "root.invalid",
                          .where = document->where,
                          .expected = error.text().expected.empty() ? "a root of trust" : error.text().expected,
                          .found = error.text().found.empty() ? error.text().what : error.text().found,
                          .fix = "get this root again from those who sign roots"});
      break;
    }
  }
  return chain;
}

}  // namespace nadir
