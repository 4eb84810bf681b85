#include "trust/signed_document.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/json.hpp"

namespace nadir {

using nlohmann::json;

std::string SignedDocument::json() const {
  const nlohmann::json envelope = nlohmann::json::parse(envelope_json({"", signatures}));
  return nlohmann::json{{"signed", nlohmann::json::parse(signed_bytes)}, {"signatures", envelope["signatures"]}}.dump(
             1) +
         "\n";
}

void SignedDocument::put(EnvelopeSignature signature) { put_signature(signatures, std::move(signature)); }

SignedDocument split_signed_document(const json& document, std::string_view payload_type, std::string_view name) {
  if (!document.is_object() || document.size() != 2 || !document.contains("signed") ||
      !document["signed"].is_object() || !document.contains("signatures")) {
    throw Error({.what = "cannot accept this signed document",
                 .where = std::string(name),
                 .expected = "an object with exactly the members \"signed\", an object, and \"signatures\"",
                 .found = document.is_object() ? "other members" : document.type_name()});
  }
  // The list of signatures has the form of an envelope's; one reader for both.
  const json envelope{{"payloadType", payload_type}, {"signatures", document["signatures"]}};
  return {document["signed"].dump(), parse_envelope(envelope.dump(), name).signatures};
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
