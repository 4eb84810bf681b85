// nadir provision autopilot: parameters, signing key, smoke test and the signed airframe file.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>

#include "base/error.hpp"
#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "commands/keys/root_signing.hpp"
#include "geodesy/angles.hpp"
#include "provision/airframe_manifest.hpp"
#include "provision/autopilot_provisioning.hpp"
#include "token_keys/token_key.hpp"
#include "vision/camera.hpp"

namespace nadir {
namespace {

class ProvisionAutopilotCommand final : public Command {
 public:
  std::string_view group() const override { return "provision"; }
  std::string_view name() const override { return "autopilot"; }
  std::string_view summary() const override { return "configure an autopilot and write its signed airframe file"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  void check_usage(const Clock& clock) const;
  std::optional<SigningKey> read_or_make_key(Context& context) const;
  Airframe airframe() const;
  void report(Context& context, const AutopilotIdentity& autopilot, const std::vector<AutopilotParameter>& parameters,
              const std::optional<Provisioned>& done) const;

  std::string url_;
  std::optional<std::filesystem::path> signing_key_, camera_, key_, out_;
  std::optional<std::string> id_;
  std::optional<std::int64_t> sequence_;
  std::optional<UtcTime> expires_;
  std::optional<int> gimbal_component_;
  int gimbal_device_ = 0;
  double yaw_deg_ = 0, pitch_deg_ = 0, roll_deg_ = 0, capture_delay_s_ = 0, patience_s_ = 10;
  int receiver_ = 1;
  bool apply_ = false;
};

std::string_view ProvisionAutopilotCommand::details() const {
  return R"(Shows the identity of an ArduPilot or PX4 autopilot and the parameters that it needs; with --apply it
sets them and reads each back, restarts the autopilot where required, installs the signing key,
tests its accelerometer and, with ArduPilot, GPS_INPUT, and finally writes airframe.json with its
signature. If a step fails, the command stops and restores what it changed. nadird compares the
parameters in airframe.json with the autopilot's before take-off.

The aircraft must be disarmed. The key crosses the link unencrypted: use a cable.

Exit codes: 0 success, or shown without --apply, 2 the job could not be done.)";
}

std::string_view ProvisionAutopilotCommand::examples() const {
  return R"(nadir provision autopilot --autopilot serial:/dev/ttyACM0:115200
nadir provision autopilot --autopilot serial:/dev/ttyACM0:115200 --apply --signing-key link.key --airframe falcon-7 --camera camera.yaml --key planner.key.pem --sequence 1 --expires 2030-01-01 --out falcon-7)";
}

void ProvisionAutopilotCommand::setup(Options& options) {
  options.value("--autopilot", url_, "URL", "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD")
      .required();
  options.flag("--apply", apply_, "change the autopilot; without it, only show");
  options.value("--receiver", receiver_, "N", "GPS receiver that GPS_INPUT takes the place of; PX4: slot EKF2_AGP(N-1)")
      .between(1, 2);
  options.value("--signing-key", signing_key_, "FILE", "signing key of the link; created with --apply if missing");
  options.value("--airframe", id_, "ID", "write an airframe file with this id").needs("--camera");
  options.value("--camera", camera_, "FILE.yaml", "camera of the airframe").needs("--key");
  options.value("--key", key_, "KEY.pem", "private key (file or pkcs11: URI) that signs the airframe file")
      .needs("--out");
  options.value("--out", out_, "DIR", "folder to create for it").needs("--airframe");
  options
      .value("--sequence", sequence_, "N",
             "number of the airframe file; higher than that of the aircraft's last one, which it then rejects")
      .between(1, 1'000'000'000)
      .needs("--out");
  options.value("--expires", expires_, "DATE", "end of validity of the airframe file").needs("--out");
  options.value("--mount-yaw-deg", yaw_deg_, "DEG", "angle from the nose to image-up, clockwise").between(-360, 360);
  options.value("--mount-pitch-deg", pitch_deg_, "DEG", "pitch of the camera in the aircraft").between(-45, 45);
  options.value("--mount-roll-deg", roll_deg_, "DEG", "roll of the camera in the aircraft").between(-45, 45);
  options
      .value("--gimbal-component", gimbal_component_, "ID",
             "the camera is on a gimbal, whose attitude this component sends (154; 1: the autopilot)")
      .between(1, 255);
  options.value("--gimbal-device", gimbal_device_, "ID", "number of the gimbal at that component").between(0, 255);
  options.value("--capture-delay-s", capture_delay_s_, "S", "delay from the exposure to the image").between(0, 5);
  options.value("--timeout-s", patience_s_, "S", "how long to wait for each answer")
      .between(0.1, 600)
      .formerly("--patience-s");
}

void ProvisionAutopilotCommand::check_usage(const Clock& clock) const {
  if (out_ && !apply_) {
    throw UsageError(
        {.what = "the airframe file is the last step of provisioning", .expected = "--apply with --airframe"});
  }
  if (out_ && std::filesystem::exists(std::filesystem::symlink_status(*out_))) {
    throw UsageError({.what = "the output already exists",
                      .where = *out_,
                      .expected = "a new folder",
                      .fix = "move it away, or choose another --out"});
  }
  if (!out_) return;
  if (!sequence_ || !expires_) {
    throw UsageError({.what = "an airframe file has a sequence and an end of validity",
                      .expected = "--sequence N and --expires DATE",
                      .found = sequence_  ? "no --expires"
                               : expires_ ? "no --sequence"
                                          : "neither",
                      .fix = "give the aircraft's first file --sequence 1, and each later one a higher number"});
  }
  check_expires(*expires_, clock);
}

std::optional<SigningKey> ProvisionAutopilotCommand::read_or_make_key(Context& context) const {
  if (!signing_key_) return {};
  if (std::filesystem::exists(*signing_key_)) return SigningKey::read(*signing_key_);
  if (!apply_) return {};
  SigningKey key = SigningKey::generate();
  key.write(*signing_key_);
  if (!context.quiet) context.err << fmt::format("created a new signing key: {}\n", signing_key_->string());
  return key;
}

Airframe ProvisionAutopilotCommand::airframe() const {
  Airframe airframe{.id = *id_,
                    .camera = read_camera_file(*camera_),
                    .mount = {radians(yaw_deg_), radians(pitch_deg_), radians(roll_deg_)},
                    .capture_delay_s = capture_delay_s_,
                    .gps_id = static_cast<std::uint8_t>(receiver_ - 1),
                    .sequence = sequence_,
                    .expires = expires_};
  if (gimbal_component_) {
    airframe.gimbal = {static_cast<std::uint8_t>(*gimbal_component_), static_cast<std::uint8_t>(gimbal_device_)};
    airframe.camera.on_gimbal = true;
  }
  return airframe;
}

int ProvisionAutopilotCommand::run(Context& context) {
  check_usage(context.clock);
  AutopilotSession session(url_, patience_s_);
  std::optional<Airframe> wanted;
  std::optional<PrivateKey> signer;
  if (id_) {
    wanted = airframe();
    signer = read_signing_key(*key_);
  }
  const std::filesystem::path signing_time = signing_key_ ? signing_key_->string() + ".time" : std::string();
  const std::optional<SigningKey> key = read_or_make_key(context);
  const LinkState link = open_detected(session, key, signing_time);
  const AutopilotIdentity autopilot = identify(session);
  const auto parameters = read_parameters(session, autopilot, receiver_);
  if (!apply_) {
    report(context, autopilot, parameters, {});
    return kAccepted;
  }
  const auto write_last = [&] {
    if (!wanted) return;
    wanted->system = autopilot.address.system;
    wanted->autopilot = autopilot.address.component;
    for (const AutopilotParameter& one : parameters) wanted->parameters.push_back({one.name, one.wanted});
    write_airframe(*out_, *wanted, *signer);
  };
  const auto tell = [&](std::string_view line) {
    if (!context.quiet) context.err << printable(line) << '\n';
  };
  const Provisioned done =
      provision(session, autopilot, link, parameters, {.receiver = receiver_, .key = key, .signing_time = signing_time},
                write_last, tell);
  report(context, autopilot, parameters, done);
  return kAccepted;
}

void ProvisionAutopilotCommand::report(Context& context, const AutopilotIdentity& autopilot,
                                       const std::vector<AutopilotParameter>& parameters,
                                       const std::optional<Provisioned>& done) const {
  if (context.json) {
    nlohmann::json document{{"autopilot", autopilot.name()},
                            {"uid", autopilot.uid},
                            {"version", autopilot.version},
                            {"system", autopilot.address.system},
                            {"component", autopilot.address.component},
                            {"applied", done.has_value()},
                            {"parameters", nlohmann::json::array()}};
    for (const AutopilotParameter& one : parameters) {
      document["parameters"].push_back({{"name", one.name}, {"found", one.present}, {"wanted", one.wanted}});
    }
    if (done) {
      document["imu_rate_hz"] = done->imu_rate_hz;
      document["restarted"] = done->restarted;
      document["key_installed"] = done->key_installed;
    }
    print_json(context.out, document);
    return;
  }
  Figures figures{
      {"autopilot", fmt::format("{} {}, system {}", autopilot.name(), autopilot.version, autopilot.address.system)},
      {"identity", autopilot.uid}};
  for (const AutopilotParameter& one : parameters) {
    const std::string change = done ? fmt::format("was {}, is {}", one.present, one.wanted)
                                    : fmt::format("is {}, should be {}", one.present, one.wanted);
    figures.emplace_back(one.name, one.differs() ? change : fmt::format("{}", one.present));
  }
  if (done) figures.emplace_back(std::string(imu_name(autopilot)), fmt::format("{:.1f} Hz", done->imu_rate_hz));
  if (done && out_) figures.emplace_back("written", out_->string());
  print_figures(context.out, figures);
  if (!done && !context.quiet) context.err << "nothing was changed; use --apply to make the changes\n";
}

}  // namespace

std::unique_ptr<Command> make_provision_autopilot() { return std::make_unique<ProvisionAutopilotCommand>(); }

}  // namespace nadir
