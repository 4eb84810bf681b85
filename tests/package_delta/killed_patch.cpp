// Applies a patch in a process of its own, and kills itself at its Nth word about its progress.
//
// Usage: killed_patch OLD PATCH ROOT.json OUT EVENT
// EVENT 0: never; the number of events is printed. Exit codes: 0 done; 1 refused; 2 error; else the signal.
#include <fmt/format.h>

#include <cstdio>
#include <string>

#include "base/error.hpp"
#include "package_build/die_at.hpp"
#include "package_delta/package_patch.hpp"

int main(int argc, char** argv) {
  using namespace nadir;
  if (argc < 6) return 64;
  try {
    const TrustRoot root = read_trusted_root(argv[3]);
    test::DieAt progress(std::stoi(argv[5]));
    const AppliedPatch applied = apply_patch(
        {.old_package = argv[1], .patch = argv[2], .out = argv[4], .root = &root, .at = UtcTime{1'714'003'200}},
        progress);
    if (applied.findings.has_errors()) return 1;
    fmt::print("{}\n", progress.seen());
    return 0;
  } catch (const Error& error) {
    fmt::print(stderr, "{}\n", error.what());
    return 2;
  }
}
