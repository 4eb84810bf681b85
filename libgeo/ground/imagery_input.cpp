#include "ground/imagery_input.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

namespace nadir {

void set_facts(Sidecar& sidecar, std::span<const ImageryInput> inputs, const InputShares& used) {
  // Upwards: 0.1614 m are not within a limit of 0.161 m.
  const auto millimetres = [](double metres) { return static_cast<std::int64_t>(std::ceil(metres * 1000.0 - 1e-6)); };
  std::map<std::string, std::uint64_t> providers;
  bool first = true;
  for (const auto& [index, pixels] : used) {
    const ImageryFacts& facts = inputs[index].facts;
    sidecar.captured_at = first ? facts.captured_at : std::min(sidecar.captured_at, facts.captured_at);
    sidecar.gsd_mm = std::max(first ? 0 : sidecar.gsd_mm, millimetres(facts.gsd_m));
    sidecar.ce90_mm = std::max(first ? 0 : sidecar.ce90_mm, millimetres(facts.ce90_m));
    providers[facts.provider] += pixels;
    first = false;
  }
  std::vector<std::pair<std::string, std::uint64_t>> order(providers.begin(), providers.end());
  std::stable_sort(order.begin(), order.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  sidecar.source.clear();
  for (const auto& [provider, pixels] : order) {
    if (!sidecar.source.empty()) sidecar.source += " + ";
    sidecar.source += provider;
  }
}

}  // namespace nadir
