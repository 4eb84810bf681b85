// `nadird`: flies with a package. `nadird --check` verifies it before take-off; `nadird --status` queries the running
// service; `nadird --play` shows a recorded flight.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "base/files.hpp"
#include "cli/command.hpp"
#include "flight/flight_service.hpp"
#include "flight/preflight.hpp"
#include "service/held_memory.hpp"
#include "verify_request/verify_request.hpp"

namespace nadir {

class Findings;
class FlightClock;
struct AcceptanceReading;
struct AcceptedPackage;
struct Opening;
struct PackageChoice;

class NadirdCommand final : public Command {
 public:
  // clock: must outlive this; null: the computer's own.
  explicit NadirdCommand(const FlightClock* clock = nullptr) : clock_(clock) {}

  std::string_view group() const override { return {}; }
  std::string_view name() const override { return {}; }  // nadird has one job
  std::string_view summary() const override { return "position for the aircraft when GPS is denied"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  void complete_request();
  void read_airframe(const AcceptanceReading& accepted, const std::string& boot_id);
  void require_service_options() const;
  void complete_link();
  Findings evaluate_airframe(const Opening& opening, const VerifyOptions& options);
  PartCheck open_second_matcher();
  Findings evaluate_tile_key(const TrustRoot& newest_root, UtcTime at);
  Opening open_verified(Context& context, const std::filesystem::path& package);
  Opening resume(Context& context, const std::filesystem::path& package, const AcceptedPackage& accepted);
  PackageChoice choose(Context& context, const AcceptanceReading& accepted, const std::string& boot_id);
  std::optional<PackageChoice> choose_unless_stopped(Context& context, const AcceptanceReading& accepted,
                                                     const std::string& boot_id, const std::stop_token& stop);
  VerifiedPackage prepared(Context& context, PackageChoice choice, AcceptanceReading& accepted,
                           const std::string& boot_id, const std::stop_token& stop);
  // What a check needs of the link; each check has one of its own.
  struct CheckedLink {
    std::unique_ptr<StagingDirectory> scratch{};
    std::unique_ptr<SigningTime> time{};
    std::optional<Signing> signing{};
    std::unique_ptr<Transport> transport{};
  };

  int check(Context& context);
  PartCheck check_camera_source() const;
  PartCheck check_autopilot_link() const;
  CheckedLink open_link() const;
  int serve(Context& context);
  int fly(Context& context);
  int play(Context& context);

  const FlightClock& flight_clock() const { return clock_ != nullptr ? *clock_ : system_clock_; }

  const FlightClock* clock_;
  SystemFlightClock system_clock_;
  FlightOptions flight_;
  std::filesystem::path package_, airframe_file_;  // the latter empty: only its id is known
  std::string airframe_text_, airframe_notice_;
  VerifyRequest request_;
  std::string second_matcher_{"auto"};
  int memory_mb_ = kUsualMemory_mb;
  bool check_ = false, status_ = false, unsigned_airframe_ = false, unsigned_link_ = false, tile_key_refused_ = false;
  std::vector<std::string> ground_stations_, loggers_;
  std::optional<std::filesystem::path> played_;  // recording
  std::optional<std::string> session_;           // of it
};

}  // namespace nadir
