// How an autopilot puts an integer parameter into the floating-point field of PARAM_VALUE and PARAM_SET. ArduPilot
// converts it to a float of the same value ("C cast"); PX4 copies its bytes ("bytewise"): the integer 1 is the float
// 1.4e-45. A REAL32 is itself in both. https://mavlink.io/en/services/parameter.html#parameter-encoding
#pragma once

#include "mavlink/messages.hpp"

namespace nadir {

enum class ParameterEncoding { cast, bytewise };

ParameterEncoding parameter_encoding(AutopilotType autopilot);

double value_of(const ParameterValue& parameter, ParameterEncoding encoding);

// For ParameterSet. Rounded and clamped to the range of an integer type.
float wire_value(double value, std::uint8_t type, ParameterEncoding encoding);

}  // namespace nadir
