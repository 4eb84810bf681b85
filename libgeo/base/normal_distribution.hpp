// Share of the standard normal distribution below z; NaN of NaN. The same bits on every processor, where std::erfc is
// rounded differently by the C libraries of amd64 and arm64.
#pragma once

namespace nadir {

double normal_share_below(double z);

}  // namespace nadir
