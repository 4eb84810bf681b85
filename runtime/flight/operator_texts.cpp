#include "flight/operator_texts.hpp"

#include <utility>

namespace nadir {

void OperatorTexts::add(TextSeverity severity, std::string text) {
  if (text.empty()) return;
  texts_.push_back({severity, std::move(text)});
  if (texts_.size() <= most_) return;
  texts_.pop_front();
  ++dropped_;
}

void OperatorTexts::tell(const Listener& listener) {
  for (const Text& told : std::exchange(texts_, {})) listener(told.severity, told.text);
}

}  // namespace nadir
