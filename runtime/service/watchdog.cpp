#include "service/watchdog.hpp"

namespace nadir {

std::optional<std::string> Watchdog::tick(double now_s) {
  std::string names, texts;
  for (const LateThread& thread : threads_.late()) {
    names += (names.empty() ? "" : ", ") + thread.name;
    texts += (texts.empty() ? "" : ", ") + thread.text();
  }
  if (names.empty() && asked_ && cadence_.due(now_s)) manager_.alive();
  if (names == late_names_) return std::nullopt;
  late_names_ = std::move(names);
  if (!texts.empty()) manager_.status("hangs: " + texts);
  return texts;
}

}  // namespace nadir
