#include "trust/signed_document.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "base/json.hpp"

namespace nadir {
namespace {

using nlohmann::json;

json to_json(const std::vector<EnvelopeSignature>& signatures) {
  json list = json::array();
  for (const EnvelopeSignature& signature : signatures) {
    list.push_back({{"keyid", signature.keyid}, {"sig", to_base64(signature.signature)}});
  }
  return list;
}

std::vector<EnvelopeSignature> read_signatures(const JsonReader& in) {
  const JsonReader list = in.array("signatures", {.least = 1, .most = kMaxSignatures});
  std::vector<EnvelopeSignature> signatures;
  std::set<std::string> seen;
  for (std::size_t i = 0; i < list.size(); ++i) {
    const JsonReader item = list.object(i);
    signatures.push_back(read_signature(item));
    item.finish();
    if (!seen.insert(signatures.back().keyid).second) item.refuse("keyid", "each key once");
  }
  return signatures;
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
  return json{{"payloadType", envelope.payload_type}, {"signatures", to_json(envelope.signatures)}}.dump() + "\n";
}

EnvelopeSignature read_signature(const JsonReader& in) {
  EnvelopeSignature signature;
  signature.keyid = in.digest("keyid").hex();
  const auto bytes = from_base64(in.text("sig"));
  if (!bytes || bytes->size() != Signature{}.size()) in.refuse("sig", "a signature of 64 bytes in base64");
  signature.signature = *bytes;
  return signature;
}

Envelope parse_envelope(std::string_view text, std::string_view name) {
  const json document = parse_json(text, name, {.max_depth = 3, .allow_floats = false});
  const JsonReader in(document, {.name = std::string(name), .what = "cannot accept this signature envelope"});
  Envelope envelope{in.text("payloadType"), read_signatures(in)};
  in.finish();
  return envelope;
}

std::string SignedDocument::json() const {
  return nlohmann::json{{"signed", nlohmann::json::parse(signed_bytes)}, {"signatures", to_json(signatures)}}.dump(1) +
         "\n";
}

void SignedDocument::put(EnvelopeSignature signature) { put_signature(signatures, std::move(signature)); }

SignedDocument split_signed_document(const json& document, std::string_view name) {
  const JsonReader in(document, {.name = std::string(name), .what = "cannot accept this signed document"});
  SignedDocument result{in.object("signed").json().dump(), read_signatures(in)};
  in.finish();
  return result;
}

std::string claimed_schema(std::string_view text, std::string_view name) {
  const json document = parse_json(text, name, {.max_depth = 8, .allow_floats = false});
  if (!document.is_object() || !document.contains("signed") || !document["signed"].is_object()) return {};
  const auto schema = document["signed"].find("schema");
  return schema != document["signed"].end() && schema->is_string() ? schema->get<std::string>() : std::string();
}

void put_signature(std::vector<EnvelopeSignature>& signatures, EnvelopeSignature signature) {
  const auto same = std::find_if(signatures.begin(), signatures.end(),
                                 [&](const EnvelopeSignature& other) { return other.keyid == signature.keyid; });
  if (same != signatures.end()) {
    *same = std::move(signature);
  } else {
    signatures.push_back(std::move(signature));
  }
}

}  // namespace nadir
