#include "trust/permit.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "base/json.hpp"
#include "trust/signatures.hpp"

namespace nadir {

SignedDocument sign_permit_document(const PermitKind& kind, nlohmann::json step, const PermitScope& scope,
                                    const std::vector<const PrivateKey*>& keys) {
  step["schema"] = kind.schema;
  step["expires"] = to_rfc3339(scope.expires);
  if (scope.airframe) step["airframe"] = *scope.airframe;
  SignedDocument document{step.dump(), {}};
  for (const PrivateKey* key : keys) {
    document.put(sign_payload(*key, kind.payload_type, as_bytes(document.signed_bytes)));
  }
  return document;
}

PermitDocument parse_permit_document(const PermitKind& kind, std::string_view text, std::string_view name,
                                     const std::function<void(const JsonReader&)>& read_step) {
  const nlohmann::json document = parse_json(text, name, {.max_depth = 4, .allow_floats = false});
  PermitDocument permit{.scope = {}, .document = split_signed_document(document, name)};
  const JsonReader parts(document,
                         {.name = std::string(name), .what = fmt::format("cannot accept this {}", kind.name)});
  const JsonReader in = parts.object("signed");
  in.expect("schema", kind.schema);
  read_step(in);
  permit.scope.airframe = in.optional_text("airframe", {.least = 1, .most = 64});
  permit.scope.expires = in.time("expires");
  in.finish();
  return permit;
}

Findings check_permit_document(const PermitKind& kind, const PermitDocument& permit, const TrustRoot& root,
                               const PermitAsker& asker, const std::vector<PermitCondition>& step) {
  const std::string where = fmt::format("the {}", kind.name);
  Findings findings = check_signatures(root, root.package_signer, permit.document.signatures, kind.payload_type,
                                       as_bytes(permit.document.signed_bytes), asker.at, where)
                          .findings;
  const auto require = [&](const PermitCondition& condition) {
    if (condition.holds) return;
    findings.add({.code = "permit.invalid",
                  .where = where,
                  .expected = condition.expected,
                  .found = condition.found,
                  .fix = fmt::format("ask the package signers for a permit for exactly this step: {}", kind.command)});
  };
  for (const PermitCondition& condition : step) require(condition);
  const PermitScope& scope = permit.scope;
  require({!scope.airframe || scope.airframe == asker.airframe,
           asker.airframe ? "a permit for airframe " + *asker.airframe
                          : "a permit for every airframe, because none was given",
           "a permit for airframe " + scope.airframe.value_or("")});
  require({asker.at < scope.expires, "a permit that is valid at " + to_rfc3339(asker.at),
           "expired " + to_rfc3339(scope.expires)});
  return findings;
}

}  // namespace nadir
