#include "upload/reason_code.hpp"

#include <algorithm>
#include <array>

namespace nadir {
namespace {

struct Entry {
  ReasonCode code;
  std::string_view name;
  bool retryable;
  std::string_view meaning;
};

constexpr std::array kEntries{
    Entry{ReasonCode::hash_mismatch, "hash_mismatch", true, "the tile's bytes do not match the digest in its sidecar"},
    Entry{ReasonCode::size_out_of_range, "size_out_of_range", false, "the tile has too many or too few bytes"},
    Entry{ReasonCode::format_unsupported, "format_unsupported", false,
          "not a JPEG or WebP image of 256 x 256 pixels, or not the format that the sidecar states"},
    Entry{ReasonCode::address_invalid, "address_invalid", false, "no tile has this zoom, column and row"},
    Entry{ReasonCode::outside_footprint, "outside_footprint", false,
          "the tile lies outside of the base package's area, or of what the frame can have seen"},
    Entry{ReasonCode::captured_in_future, "captured_in_future", false, "the capture time lies in the future"},
    Entry{ReasonCode::too_old, "too_old", false, "the image was captured too long ago"},
    Entry{ReasonCode::pose_uncertain, "pose_uncertain", false, "the frame's position is too uncertain"},
    Entry{ReasonCode::anchor_too_old, "anchor_too_old", false, "the frame's position was extrapolated for too long"},
    Entry{ReasonCode::low_texture, "low_texture", false, "the image has too little contrast to be distinctive"},
    Entry{ReasonCode::blurred, "blurred", false, "the image is not sharp enough"},
    Entry{ReasonCode::misaligned, "misaligned", false,
          "the image is misaligned with the map or with other flights' tiles"},
    Entry{ReasonCode::better_tile_exists, "better_tile_exists", false, "a better tile of this address exists"},
    Entry{ReasonCode::batch_signature, "batch_signature", false,
          "the batch's or the tile's signature is not one of this airframe's"},
    Entry{ReasonCode::airframe_revoked, "airframe_revoked", false, "the airframe's key is revoked"},
    Entry{ReasonCode::base_package_unknown, "base_package_unknown", true,
          "the service does not know the package used in flight"},
    Entry{ReasonCode::quota, "quota", true, "the airframe has exceeded its quota"},
    Entry{ReasonCode::policy, "policy", false, "the service's operator excludes it"}};

constexpr auto kCodes = [] {
  std::array<ReasonCode, kEntries.size()> codes{};
  for (std::size_t i = 0; i < codes.size(); ++i) codes[i] = kEntries[i].code;
  return codes;
}();

constexpr bool in_order() {
  for (std::size_t i = 0; i < kEntries.size(); ++i) {
    if (static_cast<std::size_t>(kEntries[i].code) != i) return false;
  }
  return true;
}
static_assert(in_order(), "a code's number is its place in the table");

const Entry& entry_of(ReasonCode code) { return kEntries[static_cast<std::size_t>(code)]; }

}  // namespace

std::span<const ReasonCode> all_reason_codes() { return kCodes; }
std::string_view name_of(ReasonCode code) { return entry_of(code).name; }
std::string_view meaning_of(ReasonCode code) { return entry_of(code).meaning; }
bool retryable(ReasonCode code) { return entry_of(code).retryable; }

std::optional<ReasonCode> parse_reason_code(std::string_view name) {
  const auto* found =
      std::find_if(kEntries.begin(), kEntries.end(), [&](const Entry& entry) { return entry.name == name; });
  return found == kEntries.end() ? std::nullopt : std::optional(found->code);
}

}  // namespace nadir
