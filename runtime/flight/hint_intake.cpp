#include "flight/hint_intake.hpp"

#include <fmt/format.h>

#include <cmath>
#include <utility>
#include <variant>

#include "mavlink/commands.hpp"
#include "service/service_rules.hpp"

namespace nadir {
namespace {

std::string sender_of(const ReceivedMessage& received) {
  return fmt::format("operator {}/{}{}", received.source.system, received.source.component,
                     received.is_signed ? "" : ", unsigned");
}

}  // namespace

HintIntake::Answer HintIntake::on_message(double now_s, const ReceivedMessage& received, bool position_known) {
  if (const auto* command = std::get_if<CommandInt>(&received.message)) return on_command(now_s, received, *command);
  if (const auto* command = std::get_if<CommandLong>(&received.message)) {
    return on_command(now_s, received, as_command_int(*command));
  }
  const auto* origin = std::get_if<SetLocalOrigin>(&received.message);
  return origin != nullptr && !position_known ? on_origin(now_s, received, *origin) : Answer{};
}

// What is no hint is answered when it is addressed to this component alone: ground stations send commands for the
// autopilot to all components.
HintIntake::Answer HintIntake::on_command(double now_s, const ReceivedMessage& received, const CommandInt& command) {
  if (!is_addressed_to(command, own_)) return {};
  const auto answer = [&](CommandResult result) { return CommandAck{command.command, result, received.source}; };
  if (!is_position_hint(command)) {
    if (command.target.component == 0) return {};
    return {.hint = {}, .acknowledgement = answer(CommandResult::unsupported)};
  }
  if (!allowance_.take(now_s)) return {.hint = {}, .acknowledgement = answer(CommandResult::temporarily_rejected)};
  const auto denied = [&](std::string why) {
    return Answer{.hint = {}, .acknowledgement = answer(CommandResult::denied), .refusal = std::move(why)};
  };
  const auto read = position_hint(command);
  if (const auto* why = std::get_if<std::string>(&read)) return denied(*why);
  const auto& hint = std::get<PositionHint>(read);
  if (hint.age_s > kMaxHintAge_s) return denied("too old");
  const double radius_m = hint.radius_m + hint.age_s * kMaxGroundSpeed_mps;
  if (radius_m > kMaxHintRadius_m) return denied("too inaccurate");
  if (distance_m_ && distance_m_(hint.place) > radius_m) return denied("outside the map");
  return {.hint = PositionHinted{hint.place, radius_m, sender_of(received)},
          .acknowledgement = answer(CommandResult::accepted)};
}

// Companion computers of the aircraft set origins too: only those of another system count.
HintIntake::Answer HintIntake::on_origin(double now_s, const ReceivedMessage& received, const SetLocalOrigin& origin) {
  const LonLat place = origin.place;
  if (origin.target_system != own_.system || received.source.system == own_.system) return {};
  if (!allowance_.take(now_s)) return {};
  const bool valid = std::abs(place.lat_deg) <= 90 && std::abs(place.lon_deg) <= 180;
  if (!valid) return {.hint = {}, .acknowledgement = {}, .refusal = "no valid place"};
  if (distance_m_ && distance_m_(place) > kOriginHintRadius_m) {
    return {.hint = {}, .acknowledgement = {}, .refusal = "outside the map"};
  }
  return {.hint = PositionHinted{place, kOriginHintRadius_m, sender_of(received)}, .acknowledgement = {}};
}

}  // namespace nadir
