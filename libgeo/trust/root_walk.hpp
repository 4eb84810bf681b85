// From the root that an aircraft has to the newest that it can reach: N → N+1 → N+2, each step signed by the thresholds
// of both sides. This is how an aircraft that was away learns of new and of revoked keys without a network.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "base/finding.hpp"
#include "trust/root.hpp"

namespace nadir {

struct RootDocument {
  std::string text;
  std::string where;  // for findings
};

// The root of this version, or nullopt when there is none.
using RootLookup = std::function<std::optional<RootDocument>(std::int64_t version)>;

struct RootWalk {
  TrustRoot root;                             // the newest that was reached
  std::map<std::int64_t, std::string> newer;  // the documents on the way, by version
  Findings findings;                          // why the walk ended before its last document
};

// Findings root.invalid (no root in form), and those of check_succession(). What is beyond a bad root is not looked at.
RootWalk walk_roots(TrustRoot trusted, const RootLookup& find);

}  // namespace nadir
