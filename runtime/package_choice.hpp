// Which package the service flies with: the wanted one, checked by all rules; or, in flight, the one that was accepted
// for this flight, which is not checked again (service/acceptance_record.hpp).
//
//                      was a package accepted, and does that hold?
//        no, or the flight has ended │                     │ armed and not landed, or accepted in this boot
//                                    ▼                     ▼
//   accept the wanted one: all rules              airborne, or the wanted one is the accepted one?
//        │ rejected          ▲                yes │             │ no: somebody put another one there, on the ground
//        ▼                   │                    ▼             └──────► accept the wanted one ── rejected ─► resume
//   accept the last          │       resume the accepted one, by digest
//   accepted one again       │                    │ not whole, or nowhere
//        │ rejected          └────────────────────┤
//        ▼                                        ▼ airborne: after the wanted one was rejected too
//   no package; tried again              resume the one before it; else no package; tried again
//
// Findings of rejected packages are kept: the operator is informed of every choice except the usual one.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

#include "package/open_package.hpp"
#include "service/acceptance_record.hpp"

namespace nadir {

// How a package is checked; both may throw.
struct PackageJudges {
  std::function<Opening(const std::filesystem::path& package)> accept;
  std::function<Opening(const std::filesystem::path& package, const AcceptedPackage& accepted)> resume;
};

struct PackageChoice {
  Opening opening;  // without a package: none could be used, and its findings state why
  std::filesystem::path folder;
  bool resumed = false;
  std::string notice{};       // in a sentence; empty: the wanted package was accepted, as usual
  std::string notice_text{};  // as a STATUSTEXT, when it is serious
  Findings rejected{};        // of packages that were passed over
};

// Throws Interrupted; and UsageError on the ground. Other failures are findings (package.unreadable).
PackageChoice choose_package(const std::filesystem::path& wanted, const AcceptanceReading& accepted,
                             std::string_view boot_id, const PackageJudges& judges);

// What is to be kept of an acceptance.
AcceptedPackage accepted_package(const std::filesystem::path& folder, const Manifest& manifest, UtcTime at,
                                 std::string airframe_file);

}  // namespace nadir
