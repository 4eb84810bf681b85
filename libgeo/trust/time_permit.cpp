#include "trust/time_permit.hpp"

#include <nlohmann/json.hpp>

#include "base/json.hpp"
#include "trust/permit.hpp"

namespace nadir {
namespace {

constexpr PermitKind kTimePermit{.schema = kTimePermitSchema,
                                 .payload_type = kTimePermitPayloadType,
                                 .name = "time permit",
                                 .command = "nadir keys permit-time"};

}  // namespace

SignedTimePermit sign_time_permit(const TimePermit& permit, const std::vector<const PrivateKey*>& keys) {
  const SignedDocument document = sign_permit_document(
      kTimePermit, {{"remembered", to_rfc3339(permit.remembered)}, {"instead", to_rfc3339(permit.instead)}},
      {permit.airframe, permit.expires}, keys);
  return parse_time_permit(document.json(), "the new permit");
}

SignedTimePermit parse_time_permit(std::string_view text, std::string_view name) {
  TimePermit permit;
  PermitDocument parsed = parse_permit_document(kTimePermit, text, name, [&permit](const JsonReader& in) {
    permit.remembered = in.time("remembered");
    permit.instead = in.time("instead");
    if (permit.instead >= permit.remembered) in.refuse("instead", "a time before \"remembered\"");
  });
  permit.airframe = std::move(parsed.scope.airframe);
  permit.expires = parsed.scope.expires;
  return {std::move(permit), std::move(parsed.document)};
}

Findings check_time_permit(const SignedTimePermit& permit, const TrustRoot& root, const TimeResetRequest& request) {
  const TimePermit& granted = permit.permit;
  return check_permit_document(
      kTimePermit, {{granted.airframe, granted.expires}, permit.document}, root, {request.airframe, request.at},
      {{granted.remembered == request.remembered, "a permit to forget " + to_rfc3339(request.remembered),
        "a permit to forget " + to_rfc3339(granted.remembered)}});
}

}  // namespace nadir
