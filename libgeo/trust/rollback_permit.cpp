#include "trust/rollback_permit.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "base/json.hpp"
#include "trust/signatures.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxText = 64;
constexpr std::int64_t kMaxPermittedSequence = std::int64_t{1} << 53;

RollbackPermit read_permit(const JsonReader& in) {
  const JsonLength length{.least = 1, .most = kMaxText};
  in.expect("schema", kPermitSchema);
  RollbackPermit permit;
  permit.series = in.text("series", length);
  permit.from = in.integer("from", 0, kMaxPermittedSequence);
  permit.to = in.integer("to", 0, kMaxPermittedSequence);
  if (permit.to >= permit.from) in.refuse("to", "a number below \"from\"");
  permit.airframe = in.optional_text("airframe", length);
  permit.expires = in.time("expires");
  in.finish();
  return permit;
}

}  // namespace

SignedPermit sign_permit(const RollbackPermit& permit, const std::vector<const PrivateKey*>& keys) {
  json body{{"schema", kPermitSchema},
            {"series", permit.series},
            {"from", permit.from},
            {"to", permit.to},
            {"expires", to_rfc3339(permit.expires)}};
  if (permit.airframe) body["airframe"] = *permit.airframe;
  SignedDocument document{body.dump(), {}};
  for (const PrivateKey* key : keys) {
    document.put(sign_payload(*key, kPermitPayloadType, as_bytes(document.signed_bytes)));
  }
  // A permit that a reader would reject must not leave this function.
  return parse_permit(document.json(), "the new permit");
}

SignedPermit parse_permit(std::string_view text, std::string_view name) {
  const json document = parse_json(text, name, {.max_depth = 4, .allow_floats = false});
  SignedDocument parts = split_signed_document(document, name);
  const JsonReader in(document, {.name = std::string(name), .what = "cannot accept this rollback permit"});
  return {read_permit(in.object("signed")), std::move(parts)};
}

Findings check_permit(const SignedPermit& permit, const TrustRoot& root, const RollbackRequest& request) {
  Findings findings = check_signatures(root, root.package_signer, permit.document.signatures, kPermitPayloadType,
                                       as_bytes(permit.document.signed_bytes), request.at, "the rollback permit")
                          .findings;
  const auto require = [&](bool holds, std::string expected, std::string found) {
    if (holds) return;
    findings.add({.code = "permit.invalid",
                  .where = "the rollback permit",
                  .expected = std::move(expected),
                  .found = std::move(found),
                  .fix = "ask the signers for a permit for exactly this: nadir keys permit-rollback"});
  };
  const RollbackPermit& granted = permit.permit;
  require(granted.series == request.series, "a permit for series " + request.series, "for series " + granted.series);
  require(granted.from == request.from && granted.to == request.to,
          fmt::format("a permit from sequence {} to {}", request.from, request.to),
          fmt::format("from {} to {}", granted.from, granted.to));
  require(!granted.airframe || granted.airframe == request.airframe,
          request.airframe ? "a permit for airframe " + *request.airframe
                           : "a permit for every airframe, because none was given",
          "for airframe " + granted.airframe.value_or(""));
  require(request.at < granted.expires, "a permit that is valid at " + to_rfc3339(request.at),
          "expired " + to_rfc3339(granted.expires));
  return findings;
}

}  // namespace nadir
