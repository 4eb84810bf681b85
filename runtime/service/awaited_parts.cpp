#include "service/awaited_parts.hpp"

#include <fmt/format.h>

#include "service/service_rules.hpp"

namespace nadir {

AwaitedParts::AwaitedParts(std::vector<Part> parts) {
  for (Part& part : parts) states_.push_back({std::move(part), false, std::nullopt, 0});
}

std::vector<std::string> AwaitedParts::update(double now_s) {
  std::vector<std::string> lines;
  for (State& state : states_) {
    const Part& part = state.part;
    if (part.here(now_s)) {
      if (state.since_s) lines.push_back(fmt::format("{}: here after {:.0f} s", part.name, now_s - *state.since_s));
      if (!state.since_s && !state.known) lines.push_back(fmt::format("{}: here", part.name));
      state.since_s.reset();
      state.known = true;
      continue;
    }
    if (!state.since_s) {
      state.since_s = now_s;
      lines.push_back(fmt::format("waiting for {}", part.wait()));
    } else if (now_s >= state.next_s) {
      lines.push_back(fmt::format("still waiting, for {:.0f} s, for {}", now_s - *state.since_s, part.wait()));
    } else {
      continue;
    }
    state.next_s = now_s + kAwaitedAgain_s;
  }
  return lines;
}

}  // namespace nadir
