#include "trust/rollback_permit.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "base/json.hpp"
#include "trust/permit.hpp"

namespace nadir {
namespace {

constexpr PermitKind kRollbackPermit{.schema = kPermitSchema,
                                     .payload_type = kPermitPayloadType,
                                     .name = "rollback permit",
                                     .command = "nadir keys permit-rollback"};
constexpr std::int64_t kMaxPermittedSequence = std::int64_t{1} << 53;

}  // namespace

SignedPermit sign_permit(const RollbackPermit& permit, const std::vector<const PrivateKey*>& keys) {
  const SignedDocument document =
      sign_permit_document(kRollbackPermit, {{"series", permit.series}, {"from", permit.from}, {"to", permit.to}},
                           {permit.airframe, permit.expires}, keys);
  return parse_permit(document.json(), "the new permit");
}

SignedPermit parse_permit(std::string_view text, std::string_view name) {
  RollbackPermit permit;
  PermitDocument parsed = parse_permit_document(kRollbackPermit, text, name, [&permit](const JsonReader& in) {
    permit.series = in.text("series", {.least = 1, .most = 64});
    permit.from = in.integer("from", 0, kMaxPermittedSequence);
    permit.to = in.integer("to", 0, kMaxPermittedSequence);
    if (permit.to >= permit.from) in.refuse("to", "a number below \"from\"");
  });
  permit.airframe = std::move(parsed.scope.airframe);
  permit.expires = parsed.scope.expires;
  return {std::move(permit), std::move(parsed.document)};
}

Findings check_permit(const SignedPermit& permit, const TrustRoot& root, const RollbackRequest& request) {
  const RollbackPermit& granted = permit.permit;
  return check_permit_document(kRollbackPermit, {{granted.airframe, granted.expires}, permit.document}, root,
                               {request.airframe, request.at},
                               {{granted.series == request.series, "a permit for series " + request.series,
                                 "a permit for series " + granted.series},
                                {granted.from == request.from && granted.to == request.to,
                                 fmt::format("a permit from sequence {} to {}", request.from, request.to),
                                 fmt::format("a permit from sequence {} to {}", granted.from, granted.to)}});
}

}  // namespace nadir
