// nadir provision autopilot: parameters, signing key, smoke test and the signed airframe file.
#pragma once

#include <filesystem>
#include <optional>

#include "cli/command.hpp"
#include "provision/provisioning.hpp"
#include "vision/camera.hpp"

namespace nadir {

class ProvisionAutopilotCommand final : public Command {
 public:
  std::string_view group() const override { return "provision"; }
  std::string_view name() const override { return "autopilot"; }
  std::string_view summary() const override { return "set up an autopilot and write its signed airframe file"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  void check_usage() const;
  std::optional<SigningKey> read_or_make_key(Context& context) const;
  Airframe airframe() const;
  void report(Context& context, const AutopilotIdentity& autopilot, const std::vector<AutopilotParameter>& parameters,
              const std::optional<Provisioned>& done) const;

  std::string url_;
  std::optional<std::filesystem::path> signing_key_, camera_, key_, out_;
  std::optional<std::string> id_;
  double yaw_deg_ = 0, pitch_deg_ = 0, roll_deg_ = 0, capture_delay_s_ = 0, patience_s_ = 10;
  int receiver_ = 1;
  bool apply_ = false;
};

}  // namespace nadir
