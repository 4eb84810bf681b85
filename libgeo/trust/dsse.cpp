#include "trust/dsse.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "base/error.hpp"
#include "base/json.hpp"
#include "base/sha256.hpp"
#include "trust/base64.hpp"

namespace nadir {
namespace {

using nlohmann::json;

[[noreturn]] void refuse(std::string_view name, std::string expected, std::string found) {
  throw Error({.what = "cannot accept this signature envelope",
               .where = std::string(name),
               .expected = std::move(expected),
               .found = std::move(found)});
}

void require_members(const json& object, std::initializer_list<const char*> members, std::string_view name) {
  const std::string expected = fmt::format("an object with exactly {} members", members.size());
  if (!object.is_object() || object.size() != members.size()) refuse(name, expected, object.type_name());
  for (const char* member : members) {
    if (!object.contains(member)) refuse(name, fmt::format("a member \"{}\"", member), "none");
  }
}

std::string text_member(const json& object, const char* member, std::string_view name) {
  if (!object[member].is_string()) refuse(name, fmt::format("text as \"{}\"", member), object[member].type_name());
  return object[member].get<std::string>();
}

EnvelopeSignature parse_signature(const json& item, std::string_view name) {
  require_members(item, {"keyid", "sig"}, name);
  EnvelopeSignature signature;
  signature.keyid = text_member(item, "keyid", name);
  if (!Sha256::from_hex(signature.keyid)) refuse(name, "a keyid of 64 hexadecimal digits", signature.keyid);
  const auto bytes = from_base64(text_member(item, "sig", name));
  if (!bytes || bytes->size() != Signature{}.size()) refuse(name, "a signature of 64 bytes in base64", "another text");
  signature.signature = *bytes;
  return signature;
}

}  // namespace

Bytes pre_authentication_encoding(std::string_view payload_type, ByteView body) {
  const std::string head = fmt::format("DSSEv1 {} {} {} ", payload_type.size(), payload_type, body.size());
  Bytes bytes(head.begin(), head.end());
  bytes.insert(bytes.end(), body.begin(), body.end());
  return bytes;
}

EnvelopeSignature sign_payload(const PrivateKey& key, std::string_view payload_type, ByteView body) {
  const Signature signature = key.sign(pre_authentication_encoding(payload_type, body));
  return {key.public_key().id(), Bytes(signature.begin(), signature.end())};
}

std::string envelope_json(const Envelope& envelope) {
  json signatures = json::array();
  for (const EnvelopeSignature& signature : envelope.signatures) {
    signatures.push_back({{"keyid", signature.keyid}, {"sig", to_base64(signature.signature)}});
  }
  return json{{"payloadType", envelope.payload_type}, {"signatures", signatures}}.dump() + "\n";
}

Envelope parse_envelope(std::string_view text, std::string_view name) {
  const json document = parse_json(text, name, {.max_depth = 3, .allow_floats = false});
  require_members(document, {"payloadType", "signatures"}, name);
  Envelope envelope;
  envelope.payload_type = text_member(document, "payloadType", name);
  const json& signatures = document["signatures"];
  if (!signatures.is_array() || signatures.empty() || signatures.size() > kMaxSignatures) {
    refuse(name, fmt::format("a list of 1 to {} signatures", kMaxSignatures), signatures.type_name());
  }
  std::set<std::string> seen;
  for (const json& item : signatures) {
    envelope.signatures.push_back(parse_signature(item, name));
    if (!seen.insert(envelope.signatures.back().keyid).second) refuse(name, "each key once", "a key twice");
  }
  return envelope;
}

}  // namespace nadir
