// The file form of the trust root: strict both ways.
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/json.hpp"
#include "base/sha256.hpp"
#include "trust/base64.hpp"
#include "trust/root.hpp"
#include "trust/signed_document.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::uint32_t kMaxThreshold = 32;

class RootReader {
 public:
  explicit RootReader(std::string_view name) : name_(name) {}

  SignedRoot read(const json& document) const {
    require_members(document, "the file", {"signed", "signatures"});
    SignedRoot result;
    result.root = read_signed(document["signed"]);
    result.signed_bytes = document["signed"].dump();
    result.signatures = split_signed_document(document, kRootPayloadType, name_).signatures;
    return result;
  }

 private:
  [[noreturn]] void refuse(std::string_view where, std::string expected, std::string found) const {
    throw Error({.what = "cannot accept this trust root",
                 .where = fmt::format("{}: {}", name_, where),
                 .expected = std::move(expected),
                 .found = std::move(found)});
  }

  void require_members(const json& object, std::string_view where, std::initializer_list<std::string_view> must,
                       std::initializer_list<std::string_view> may = {}) const {
    if (!object.is_object()) refuse(where, "an object", object.type_name());
    for (const std::string_view member : must) {
      if (!object.contains(member)) refuse(where, fmt::format("a member \"{}\"", member), "none");
    }
    for (const auto& [member, ignored] : object.items()) {
      const bool known = std::find(must.begin(), must.end(), member) != must.end() ||
                         std::find(may.begin(), may.end(), member) != may.end();
      if (!known) refuse(where, "only members that this version knows", "\"" + member + "\"");
    }
  }

  std::string text(const json& value, std::string_view where) const {
    if (!value.is_string()) refuse(where, "text", value.type_name());
    return value.get<std::string>();
  }

  std::string key_id(const json& value, std::string_view where) const {
    const std::string id = text(value, where);
    if (!Sha256::from_hex(id)) refuse(where, "a key id of 64 hexadecimal digits", id);
    return id;
  }

  UtcTime time(const json& value, std::string_view where) const {
    const auto parsed = parse_utc(text(value, where));
    if (!parsed) refuse(where, "a time like 2030-01-01T00:00:00Z", value.dump());
    return *parsed;
  }

  std::set<std::string> key_ids(const json& value, std::string_view where) const {
    if (!value.is_array() || value.size() > 1024) refuse(where, "a list of key ids", value.type_name());
    std::set<std::string> ids;
    for (const json& item : value) {
      if (!ids.insert(key_id(item, where)).second) refuse(where, "each key once", item.dump());
    }
    return ids;
  }

  TrustedKey key(const std::string& id, const json& value) const {
    const std::string where = "key " + id;
    require_members(value, where, {"algorithm", "public"}, {"expires"});
    if (value["algorithm"] != "ed25519") refuse(where, "the algorithm \"ed25519\"", value["algorithm"].dump());
    const auto raw = from_base64(text(value["public"], where));
    if (!raw || raw->size() != 32) refuse(where, "32 bytes in base64", value["public"].dump());
    TrustedKey trusted{PublicKey::from_raw(*raw), std::nullopt};
    if (trusted.key.id() != id) refuse(where, "the id that follows from the key: " + trusted.key.id(), id);
    if (value.contains("expires")) trusted.expires = time(value["expires"], where);
    return trusted;
  }

  Role role(const json& value, const std::string& where, const TrustRoot& root) const {
    require_members(value, where, {"keyids", "threshold"});
    Role result;
    result.key_ids = key_ids(value["keyids"], where);
    for (const std::string& id : result.key_ids) {
      if (!root.keys.contains(id)) refuse(where, "keys that are listed in \"keys\"", id);
    }
    const json& threshold = value["threshold"];
    const std::size_t most = std::min<std::size_t>(result.key_ids.size(), kMaxThreshold);
    if (!threshold.is_number_unsigned() || threshold.get<std::uint64_t>() < 1 ||
        threshold.get<std::uint64_t>() > most) {
      refuse(where, fmt::format("a threshold from 1 to the number of keys, {}", most), threshold.dump());
    }
    result.threshold = threshold.get<std::uint32_t>();
    return result;
  }

  TrustRoot read_signed(const json& value) const {
    require_members(value, "signed", {"schema", "version", "expires", "keys", "roles", "revoked"});
    if (value["schema"] != kRootSchema) refuse("schema", fmt::format("\"{}\"", kRootSchema), value["schema"].dump());
    TrustRoot root;
    const json& version = value["version"];
    if (!version.is_number_unsigned() || version.get<std::uint64_t>() < 1 ||
        version.get<std::uint64_t>() > (std::uint64_t{1} << 31)) {
      refuse("version", "a whole number from 1", version.dump());
    }
    root.version = version.get<std::int64_t>();
    root.expires = time(value["expires"], "expires");
    if (!value["keys"].is_object()) refuse("keys", "an object", value["keys"].type_name());
    for (const auto& [id, item] : value["keys"].items()) root.keys.emplace(id, key(id, item));
    const json& roles = value["roles"];
    require_members(roles, "roles", {"root", "package-signer"}, {"tile-signer", "airframe-signer"});
    root.root = role(roles["root"], "role root", root);
    root.package_signer = role(roles["package-signer"], "role package-signer", root);
    if (roles.contains("tile-signer")) {
      if (!roles["tile-signer"].is_object()) refuse("tile-signer", "an object by airframe", "something else");
      for (const auto& [airframe, item] : roles["tile-signer"].items()) {
        root.tile_signers.emplace(airframe, role(item, "role tile-signer " + airframe, root));
      }
    }
    if (roles.contains("airframe-signer")) {
      root.airframe_signer = role(roles["airframe-signer"], "role airframe-signer", root);
    }
    root.revoked = key_ids(value["revoked"], "revoked");
    return root;
  }

  std::string_view name_;
};

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

SignedRoot sign_root(TrustRoot root, const std::vector<const PrivateKey*>& keys) {
  SignedRoot result;
  result.signed_bytes = to_json(root).dump();
  for (const PrivateKey* key : keys) {
    add_signature(result, *key);
  }
  result.root = std::move(root);
  // A root that a reader would refuse must not leave this function.
  return parse_root(result.json(), "the new trust root");
}

void add_signature(SignedRoot& root, const PrivateKey& key) {
  put_signature(root.signatures, sign_payload(key, kRootPayloadType, as_bytes(root.signed_bytes)));
}

std::string SignedRoot::json() const { return SignedDocument{signed_bytes, signatures}.json(); }

SignedRoot parse_root(std::string_view text, std::string_view name) {
  return RootReader(name).read(parse_json(text, name, {.max_depth = 8, .allow_floats = false}));
}

}  // namespace nadir
