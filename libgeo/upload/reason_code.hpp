// Why a candidate tile is refused or rejected: a closed list, the same on both sides of the upload
// (schemas/candidates.openapi.yaml). A code never changes its meaning; a new one needs a new version of the list, so
// that no reader meets an unknown code.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

namespace nadir {

inline constexpr int kReasonCodesVersion = 1;

enum class ReasonCode : std::uint8_t {
  hash_mismatch,
  size_out_of_range,
  format_unsupported,
  address_invalid,
  outside_footprint,
  captured_in_future,
  too_old,
  pose_uncertain,
  anchor_too_old,
  low_texture,
  blurred,
  misaligned,
  better_tile_exists,
  batch_signature,
  airframe_revoked,
  base_package_unknown,
  quota,
  policy
};

std::span<const ReasonCode> all_reason_codes();  // in the order above

std::string_view name_of(ReasonCode code);     // "hash_mismatch"
std::string_view meaning_of(ReasonCode code);  // one line for people, lower case, no full stop
std::optional<ReasonCode> parse_reason_code(std::string_view name);

// Whether the same tile may be accepted later unchanged.
bool retryable(ReasonCode code);

}  // namespace nadir
