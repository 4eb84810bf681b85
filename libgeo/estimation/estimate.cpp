#include "estimation/estimate.hpp"

namespace nadir {

std::string_view name_of(AnchorVerdict verdict) {
  switch (verdict) {
    case AnchorVerdict::not_tried: return "not_tried";
    case AnchorVerdict::accepted: return "accepted";
    case AnchorVerdict::frame_unfit: return "frame_unfit";
    case AnchorVerdict::no_map: return "no_map";
    case AnchorVerdict::ambiguous: return "ambiguous";
    case AnchorVerdict::few_inliers: return "few_inliers";
    case AnchorVerdict::bad_geometry: return "bad_geometry";
    case AnchorVerdict::off_prediction: return "off_prediction";
    case AnchorVerdict::awaiting_votes: return "awaiting_votes";
  }
  return "not_tried";
}

}  // namespace nadir
