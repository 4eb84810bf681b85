#include "trust/time_permit.hpp"

#include <nlohmann/json.hpp>

#include "base/json.hpp"
#include "trust/signatures.hpp"

namespace nadir {
namespace {

using nlohmann::json;

TimePermit read_time_permit(const JsonReader& in) {
  in.expect("schema", kTimePermitSchema);
  TimePermit permit;
  permit.remembered = in.time("remembered");
  permit.instead = in.time("instead");
  if (permit.instead >= permit.remembered) in.refuse("instead", "a time before \"remembered\"");
  permit.airframe = in.optional_text("airframe", {.least = 1, .most = 64});
  permit.expires = in.time("expires");
  in.finish();
  return permit;
}

}  // namespace

SignedTimePermit sign_time_permit(const TimePermit& permit, const std::vector<const PrivateKey*>& keys) {
  json body{{"schema", kTimePermitSchema},
            {"remembered", to_rfc3339(permit.remembered)},
            {"instead", to_rfc3339(permit.instead)},
            {"expires", to_rfc3339(permit.expires)}};
  if (permit.airframe) body["airframe"] = *permit.airframe;
  SignedDocument document{body.dump(), {}};
  for (const PrivateKey* key : keys) {
    document.put(sign_payload(*key, kTimePermitPayloadType, as_bytes(document.signed_bytes)));
  }
  // A permit that a reader would reject must not leave this function.
  return parse_time_permit(document.json(), "the new permit");
}

SignedTimePermit parse_time_permit(std::string_view text, std::string_view name) {
  const json document = parse_json(text, name, {.max_depth = 4, .allow_floats = false});
  SignedDocument parts = split_signed_document(document, name);
  const JsonReader in(document, {.name = std::string(name), .what = "cannot accept this time permit"});
  return {read_time_permit(in.object("signed")), std::move(parts)};
}

Findings check_time_permit(const SignedTimePermit& permit, const TrustRoot& root, const TimeResetRequest& request) {
  Findings findings = check_signatures(root, root.package_signer, permit.document.signatures, kTimePermitPayloadType,
                                       as_bytes(permit.document.signed_bytes), request.at, "the time permit")
                          .findings;
  const auto require = [&](bool holds, std::string expected, std::string found) {
    if (holds) return;
    findings.add({.code = "permit.invalid",
                  .where = "the time permit",
                  .expected = std::move(expected),
                  .found = std::move(found),
                  .fix = "ask the signers for a permit for exactly this: nadir keys permit-time"});
  };
  const TimePermit& granted = permit.permit;
  require(granted.remembered == request.remembered, "a permit to forget " + to_rfc3339(request.remembered),
          "a permit to forget " + to_rfc3339(granted.remembered));
  require(!granted.airframe || granted.airframe == request.airframe,
          request.airframe ? "a permit for airframe " + *request.airframe
                           : "a permit for every airframe, because none was given",
          "for airframe " + granted.airframe.value_or(""));
  require(request.at < granted.expires, "a permit that is valid at " + to_rfc3339(request.at),
          "expired " + to_rfc3339(granted.expires));
  return findings;
}

}  // namespace nadir
