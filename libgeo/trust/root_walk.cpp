#include "trust/root_walk.hpp"

#include "base/error.hpp"

namespace nadir {
namespace {

constexpr int kMaxSteps = 256;  // more roots than an aircraft sees in its life

}  // namespace

RootWalk walk_roots(TrustRoot trusted, const RootLookup& find) {
  RootWalk walk{std::move(trusted), {}, {}};
  for (int step = 0; step < kMaxSteps; ++step) {
    const auto document = find(walk.root.version + 1);
    if (!document) break;
    try {
      SignedRoot next = parse_root(document->text, document->where);
      const Findings findings = check_succession(walk.root, next);
      walk.findings.add(findings);
      if (findings.refuses()) break;
      walk.root = std::move(next.root);
      walk.newer.emplace(walk.root.version, document->text);
    } catch (const Error& error) {
      walk.findings.add({.code = "root.invalid",
                         .where = document->where,
                         .expected = error.text().expected.empty() ? "a root of trust" : error.text().expected,
                         .found = error.text().found.empty() ? error.text().what : error.text().found,
                         .fix = "get the package again from its makers"});
      break;
    }
  }
  return walk;
}

}  // namespace nadir
