// nadird's command as these tests call it: a folder with a trust root, packages of its signer and an airframe, a clock
// that is set, and a flight that ends as soon as it would wait for something.
#pragma once

#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <initializer_list>
#include <mutex>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "cli/program.hpp"
#include "nadird_command.hpp"
#include "package/package_maker.hpp"
#include "support/manual_clock.hpp"

namespace nadir::test {

// In that boot of the computer: the flight ends as soon as one of its threads waits.
class BriefFlight final : public FlightClock {
 public:
  explicit BriefFlight(std::string boot = "boot-1") : still_(1000, 1'750'000'000'000'000, std::move(boot)) {}
  double monotonic_s() const override { return still_.monotonic_s(); }
  std::int64_t unix_us() const override { return still_.unix_us(); }
  const std::string& boot_id() const override { return still_.boot_id(); }
  bool wait_until(double until_s, std::stop_token stop) const override {
    std::call_once(ended_, [] { ::kill(::getpid(), SIGTERM); });
    return still_.wait_until(until_s, std::move(stop));
  }

 private:
  ManualClock still_;
  mutable std::once_flag ended_;
};

class NadirdFixture : public ::testing::Test {
 protected:
  NadirdFixture() { folder_.write("root.json", sign_root(maker_.root, {&maker_.signer}).json()); }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  // A package of the default mission with that sequence.
  std::string make_package(const std::string& name, int sequence) {
    maker_.mission = mission_yaml({{"sequence: 3", "sequence: " + std::to_string(sequence)}});
    return maker_.make(folder_, name).string();
  }

  // mini-07 as the packages name it, with a camera that nobody looks through. members: more of them, each with a comma.
  static std::string airframe_json(const std::string& members = {}) {
    return R"({"format": "nadir.airframe/1", "airframe": "mini-07", )" + members +
           R"("camera": {"model": "pinhole", "width": 640, "height": 480, "fx": 500, "fy": 500, "cx": 319.5, "cy": 239.5}})";
  }

  // The service's options, but for those that say how its link is signed.
  std::vector<std::string> service_options(const std::string& package, const std::string& airframe,
                                           const std::string& camera) const {
    return {"--package", package,       "--trust",  path("root.json"), "--airframe",  path(airframe),
            "--state",   path("state"), "--camera", path(camera),      "--autopilot", "udpin:127.0.0.1:0"};
  }

  int run(const std::vector<std::string>& args, const Clock& clock, const FlightClock* flight = nullptr) {
    out_.str("");
    err_.str("");
    NadirdCommand command(flight);
    return run_single_command("nadird", command, args, {out_, err_, clock});
  }
  int run_service(std::vector<std::string> args, std::initializer_list<std::string> more, const Clock& clock,
                  const FlightClock* flight) {
    args.insert(args.end(), {"--listen", "127.0.0.1:0", "--memory-mb", "0", "--unsigned-link"});
    args.insert(args.end(), more);
    return run(args, clock, flight);
  }

  TemporaryFolder folder_;
  std::ostringstream out_, err_;
  PackageMaker maker_;
};

}  // namespace nadir::test
