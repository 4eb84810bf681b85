// Permits: by one, package signers allow aircraft one step that they refuse otherwise, such as going back to an older
// package (rollback_permit.hpp) or to an earlier time (time_permit.hpp). All have one form,
//   {"signed": {"schema", …the step…, "expires"[, "airframe"]}, "signatures": […]}
// one signature rule (the root's package signers, with the same threshold as for packages) and one check: a permit
// allows exactly the step that it names, until it expires, and on its airframe only if it names one. A kind of permit
// adds its step.
#pragma once

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "base/time.hpp"
#include "trust/root.hpp"
#include "trust/signed_document.hpp"

namespace nadir {

struct PermitKind {
  std::string_view schema;        // "nadir.time-permit/1"
  std::string_view payload_type;  // that is signed with it
  std::string_view name;          // for messages: "time permit"
  std::string_view command;       // that makes one
};

// For whom a permit is, and until when.
struct PermitScope {
  std::optional<std::string> airframe;  // none: every aircraft
  UtcTime expires;
};

// Who asks, and when.
struct PermitAsker {
  std::optional<std::string> airframe;
  UtcTime at;
};

// One condition of a step, for the finding when it does not hold.
struct PermitCondition {
  bool holds = false;
  std::string expected, found;
};

// step: the members of this kind. What a reader would refuse must not leave the caller: parse the result.
SignedDocument sign_permit_document(const PermitKind& kind, nlohmann::json step, const PermitScope& scope,
                                    const std::vector<const PrivateKey*>& keys);

struct PermitDocument {
  PermitScope scope{};
  SignedDocument document;
};

// Checks the form alone; read_step takes the members of this kind. Throws Error.
PermitDocument parse_permit_document(const PermitKind& kind, std::string_view json, std::string_view name,
                                     const std::function<void(const JsonReader&)>& read_step);

// No findings when the permit is signed, valid, for the asker, and every condition of its step holds. Otherwise
// permit.invalid, and the findings on its signatures.
Findings check_permit_document(const PermitKind& kind, const PermitDocument& permit, const TrustRoot& root,
                               const PermitAsker& asker, const std::vector<PermitCondition>& step);

}  // namespace nadir
