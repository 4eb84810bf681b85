// nadird with a clock that runs a multiple of real time, so that hours are flown in minutes:
// NADIR_SOAK_SPEED=8 bench_fast_nadird OPTIONS… Everything else is nadird's own. `./run bench soak` flies it.
#include <cmath>
#include <cstdlib>
#include <iostream>

#include "base/error.hpp"
#include "cli/program.hpp"
#include "cli/terminal.hpp"
#include "nadird_command.hpp"
#include "service/clock.hpp"

namespace nadir {
namespace {

class FastClock final : public FlightClock {
 public:
  explicit FastClock(double speed) : speed_(speed), began_s_(real_.monotonic_s()), began_us_(real_.unix_us()) {}

  double monotonic_s() const override { return began_s_ + speed_ * gone_s(); }
  std::int64_t unix_us() const override { return began_us_ + std::llround(speed_ * gone_s() * 1e6); }
  const std::string& boot_id() const override { return real_.boot_id(); }
  bool wait_until(double until_s, std::stop_token stop) const override {
    return real_.wait_until(began_s_ + (until_s - began_s_) / speed_, std::move(stop));
  }

 private:
  double gone_s() const { return real_.monotonic_s() - began_s_; }

  SystemFlightClock real_;
  double speed_, began_s_;
  std::int64_t began_us_;
};

double wanted_speed() {
  const char* text = std::getenv("NADIR_SOAK_SPEED");
  const double speed = text == nullptr ? 1 : std::atof(text);
  return speed >= 1 && speed <= 100 ? speed : 1;
}

}  // namespace
}  // namespace nadir

int main(int argc, char** argv) {
  nadir::install_signal_handlers();
  const nadir::SystemClock clock;
  const nadir::FastClock fast(nadir::wanted_speed());
  nadir::NadirdCommand command(&fast);
  return nadir::run_single_command("nadird", command, {argv + 1, argv + argc}, {std::cout, std::cerr, clock});
}
