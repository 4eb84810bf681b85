#include "trust/rollback_permit.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <set>

#include "base/error.hpp"
#include "base/json.hpp"
#include "trust/signatures.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxText = 64;
constexpr std::uint64_t kMaxSequence = std::uint64_t{1} << 53;

[[noreturn]] void refuse(std::string_view name, std::string_view member, std::string expected, const json& found) {
  throw Error({.what = "cannot accept this rollback permit",
               .where = fmt::format("{}: {}", name, member),
               .expected = std::move(expected),
               .found = found.dump().substr(0, 80)});
}

class PermitReader {
 public:
  PermitReader(const json& object, std::string_view name) : object_(object), name_(name) {}

  RollbackPermit read() const {
    static const std::set<std::string> known{"schema", "series", "from", "to", "expires", "airframe"};
    for (const auto& [member, value] : object_.items()) {
      if (!known.contains(member)) refuse(name_, member, "only members that this version knows", value);
    }
    if (text("schema") != kPermitSchema) {
      refuse(name_, "schema", fmt::format("\"{}\"", kPermitSchema), object_["schema"]);
    }
    RollbackPermit permit;
    permit.series = text("series");
    permit.from = sequence("from");
    permit.to = sequence("to");
    if (permit.to >= permit.from) refuse(name_, "to", "a number below \"from\"", object_["to"]);
    if (object_.contains("airframe")) permit.airframe = text("airframe");
    const auto expires = parse_utc(text("expires"));
    if (!expires) refuse(name_, "expires", "a time like 2030-01-01T00:00:00Z", object_["expires"]);
    permit.expires = *expires;
    return permit;
  }

 private:
  const json& member(const char* key) const {
    const auto found = object_.find(key);
    if (found == object_.end()) refuse(name_, key, "this member", nullptr);
    return *found;
  }

  std::string text(const char* key) const {
    const json& value = member(key);
    if (!value.is_string() || value.get_ref<const std::string&>().empty() ||
        value.get_ref<const std::string&>().size() > kMaxText) {
      refuse(name_, key, fmt::format("text of 1 to {} bytes", kMaxText), value);
    }
    return value.get<std::string>();
  }

  std::int64_t sequence(const char* key) const {
    const json& value = member(key);
    if (!value.is_number_unsigned() || value.get<std::uint64_t>() > kMaxSequence) {
      refuse(name_, key, "a whole number from 0", value);
    }
    return value.get<std::int64_t>();
  }

  const json& object_;
  std::string_view name_;
};

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
  result.permit = PermitReader(document["signed"], name).read();
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
