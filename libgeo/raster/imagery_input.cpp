#include "raster/imagery_input.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <string_view>
#include <utility>

namespace nadir {
namespace {

constexpr std::string_view kBetweenNames = " + ";

// Of a provider that is the source of a tile which several had made.
std::vector<std::string_view> names_in(std::string_view provider) {
  std::vector<std::string_view> names;
  for (std::size_t end = provider.find(kBetweenNames); end != std::string_view::npos;
       end = provider.find(kBetweenNames)) {
    names.push_back(provider.substr(0, end));
    provider.remove_prefix(end + kBetweenNames.size());
  }
  names.push_back(provider);
  return names;
}

}  // namespace

void set_facts(Sidecar& sidecar, std::span<const ImageryInput> inputs, const InputShares& used) {
  // Upwards: 0.1614 m are not within a limit of 0.161 m.
  const auto millimetres = [](double metres) { return static_cast<std::int64_t>(std::ceil(metres * 1000.0 - 1e-6)); };
  std::map<std::string, std::uint64_t> providers;
  sidecar.trust = TileTrust::service;
  bool first = true;
  for (const auto& [index, pixels] : used) {
    const ImageryFacts& facts = inputs[index].facts;
    sidecar.captured_at = first ? facts.captured_at : std::min(sidecar.captured_at, facts.captured_at);
    sidecar.gsd_mm = std::max(first ? 0 : sidecar.gsd_mm, millimetres(facts.gsd_m));
    sidecar.ce90_mm = std::max(first ? 0 : sidecar.ce90_mm, millimetres(facts.ce90_m));
    sidecar.trust = std::max(sidecar.trust, inputs[index].trust);
    providers[facts.provider] += pixels;
    first = false;
  }
  std::vector<std::pair<std::string, std::uint64_t>> order(providers.begin(), providers.end());
  std::stable_sort(order.begin(), order.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  std::vector<std::string_view> names;
  for (const auto& [provider, pixels] : order) {
    for (const std::string_view name : names_in(provider)) {
      if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
    }
  }
  sidecar.source = fmt::format("{}", fmt::join(names, kBetweenNames));
}

}  // namespace nadir
