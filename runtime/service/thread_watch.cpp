#include "service/thread_watch.hpp"

#include <fmt/format.h>

namespace nadir {

std::string LateThread::text() const {
  return fmt::format("{} silent for {:.1f} s (at most {} s)", name, silent_s, limit_s);
}

ThreadWatch::Beat ThreadWatch::watch(std::string name, double limit_s) {
  auto watched = std::make_shared<Watched>(std::move(name), limit_s, clock_.monotonic_s());
  const std::scoped_lock lock(mutex_);
  watched_.push_back(watched);
  return {std::move(watched), clock_};
}

std::vector<LateThread> ThreadWatch::late() const {
  const std::scoped_lock lock(mutex_);
  watched_.remove_if([](const auto& watched) { return watched->ended.load(); });
  const double now_s = clock_.monotonic_s();
  std::vector<LateThread> late;
  for (const auto& watched : watched_) {
    const double silent_s = now_s - watched->last_s.load();
    if (silent_s > watched->limit_s) late.push_back({watched->name, silent_s, watched->limit_s});
  }
  return late;
}

}  // namespace nadir
