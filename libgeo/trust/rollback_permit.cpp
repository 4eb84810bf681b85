#include "trust/rollback_permit.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "base/json.hpp"
#include "base/json_members.hpp"
#include "trust/signatures.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxText = 64;
constexpr std::int64_t kMaxSequence = std::int64_t{1} << 53;

constexpr JsonMembers::Complaint kComplaint{"cannot accept this rollback permit"};

std::string text(const JsonMembers& in, const char* key) {
  const std::string& value = in.text(key);
  if (value.empty() || value.size() > kMaxText) in.refuse(key, fmt::format("text of 1 to {} bytes", kMaxText), value);
  return value;
}

RollbackPermit read_permit(const json& object, std::string_view name) {
  const bool of_one_airframe = object.contains("airframe");
  const JsonMembers in(object, std::string(name), of_one_airframe ? 6 : 5, kComplaint);
  if (text(in, "schema") != kPermitSchema) in.refuse("schema", fmt::format("\"{}\"", kPermitSchema), in.text("schema"));
  RollbackPermit permit;
  permit.series = text(in, "series");
  permit.from = in.whole("from", 0, kMaxSequence);
  permit.to = in.whole("to", 0, kMaxSequence);
  if (permit.to >= permit.from) in.refuse("to", "a number below \"from\"", permit.to);
  if (of_one_airframe) permit.airframe = text(in, "airframe");
  const auto expires = parse_utc(text(in, "expires"));
  if (!expires) in.refuse("expires", "a time like 2030-01-01T00:00:00Z", in.text("expires"));
  permit.expires = *expires;
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
  // A permit that a reader would refuse must not leave this function.
  return parse_permit(document.json(), "the new permit");
}

SignedPermit parse_permit(std::string_view text, std::string_view name) {
  const json document = parse_json(text, name, {.max_depth = 4, .allow_floats = false});
  SignedPermit result;
  result.document = split_signed_document(document, kPermitPayloadType, name);
  result.permit = read_permit(document["signed"], name);
  return result;
}

Findings check_permit(const SignedPermit& permit, const TrustRoot& root, const RollbackWish& wish) {
  Findings findings = check_signatures(root, root.package_signer, permit.document.signatures, kPermitPayloadType,
                                       as_bytes(permit.document.signed_bytes), wish.at, "the rollback permit")
                          .findings;
  const auto demand = [&](bool holds, std::string expected, std::string found) {
    if (holds) return;
    findings.add({.code = "permit.invalid",
                  .where = "the rollback permit",
                  .expected = std::move(expected),
                  .found = std::move(found),
                  .fix = "get a permit for exactly this from the signers: nadir keys permit-rollback"});
  };
  const RollbackPermit& given = permit.permit;
  demand(given.series == wish.series, "a permit for series " + wish.series, "for series " + given.series);
  demand(given.from == wish.from && given.to == wish.to,
         fmt::format("a permit from sequence {} to {}", wish.from, wish.to),
         fmt::format("from {} to {}", given.from, given.to));
  demand(!given.airframe || given.airframe == wish.airframe,
         wish.airframe ? "a permit for airframe " + *wish.airframe : "a permit for every airframe, as none was named",
         "for airframe " + given.airframe.value_or(""));
  demand(wish.at < given.expires, "a permit that is valid at " + to_rfc3339(wish.at),
         "expired " + to_rfc3339(given.expires));
  return findings;
}

}  // namespace nadir
