// Hands the latest of something from one thread to another; what nobody took is replaced. Neither side ever waits: a
// letter changes hands in one atomic exchange.
#pragma once

#include <atomic>
#include <memory>
#include <utility>

namespace nadir {

template <typename Letter>
class Mailbox {
 public:
  Mailbox() = default;
  ~Mailbox() { delete box_.load(); }
  Mailbox(const Mailbox&) = delete;
  Mailbox& operator=(const Mailbox&) = delete;

  void put(Letter letter) { delete box_.exchange(new Letter(std::move(letter)), std::memory_order_acq_rel); }

  // Null when nothing has come since the last time.
  std::unique_ptr<Letter> take() { return std::unique_ptr<Letter>(box_.exchange(nullptr, std::memory_order_acq_rel)); }

 private:
  std::atomic<Letter*> box_{nullptr};
};

}  // namespace nadir
