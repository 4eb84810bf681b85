#include "mavlink/parameters.hpp"

#include <ardupilotmega/mavlink.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>

namespace nadir {
namespace {

// The field begins with the integer's bytes (param_union.h of MAVLink's C library); the rest are zeros.
template <class Integer>
float field_of(double value) {
  const double low = static_cast<double>(std::numeric_limits<Integer>::min());
  const double high = static_cast<double>(std::numeric_limits<Integer>::max());
  const auto integer = static_cast<Integer>(std::llround(std::clamp(std::isnan(value) ? 0 : value, low, high)));
  return std::bit_cast<float>(static_cast<std::uint32_t>(static_cast<std::make_unsigned_t<Integer>>(integer)));
}

template <class Integer>
double integer_of(float field) {
  return static_cast<double>(static_cast<Integer>(std::bit_cast<std::uint32_t>(field)));
}

}  // namespace

ParameterEncoding parameter_encoding(AutopilotType autopilot) {
  return autopilot == AutopilotType::px4 ? ParameterEncoding::bytewise : ParameterEncoding::cast;
}

double value_of(const ParameterValue& parameter, ParameterEncoding encoding) {
  const float field = parameter.wire_value;
  if (encoding == ParameterEncoding::cast) return static_cast<double>(field);
  switch (parameter.type) {
    case MAV_PARAM_TYPE_UINT8: return integer_of<std::uint8_t>(field);
    case MAV_PARAM_TYPE_INT8: return integer_of<std::int8_t>(field);
    case MAV_PARAM_TYPE_UINT16: return integer_of<std::uint16_t>(field);
    case MAV_PARAM_TYPE_INT16: return integer_of<std::int16_t>(field);
    case MAV_PARAM_TYPE_UINT32: return integer_of<std::uint32_t>(field);
    case MAV_PARAM_TYPE_INT32: return integer_of<std::int32_t>(field);
    default: return static_cast<double>(field);
  }
}

float wire_value(double value, std::uint8_t type, ParameterEncoding encoding) {
  if (encoding == ParameterEncoding::cast) return static_cast<float>(value);
  switch (type) {
    case MAV_PARAM_TYPE_UINT8: return field_of<std::uint8_t>(value);
    case MAV_PARAM_TYPE_INT8: return field_of<std::int8_t>(value);
    case MAV_PARAM_TYPE_UINT16: return field_of<std::uint16_t>(value);
    case MAV_PARAM_TYPE_INT16: return field_of<std::int16_t>(value);
    case MAV_PARAM_TYPE_UINT32: return field_of<std::uint32_t>(value);
    case MAV_PARAM_TYPE_INT32: return field_of<std::int32_t>(value);
    default: return static_cast<float>(value);
  }
}

}  // namespace nadir
