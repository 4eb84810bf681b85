// The present time to the millisecond, and waiting: both come in from outside, so that tests wait for nothing.
#pragma once

#include <cstdint>
#include <functional>

namespace nadir {

class Pace {
 public:
  virtual ~Pace() = default;
  virtual std::int64_t now_ms() const = 0;  // since 1970
  // Calls `check` now and then; what it throws ends the wait.
  virtual void wait(std::int64_t duration_ms, const std::function<void()>& check) = 0;
};

class SystemPace final : public Pace {
 public:
  std::int64_t now_ms() const override;
  void wait(std::int64_t duration_ms, const std::function<void()>& check) override;
};

}  // namespace nadir
