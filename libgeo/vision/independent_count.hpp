// How many independent measurements a crowd of neighbouring ones is worth.
//
// Patches overlap, a roof displaces all features on it, a shutter bends whole rows: residuals of neighbours are alike,
// and counting each as a witness of its own makes a solution look better than it is. Their correlation over distance is
// taken from the residuals themselves: N / (1 + mean over the measurements of the sum of the others' correlations).
#pragma once

#include <Eigen/Core>
#include <vector>

namespace nadir {

// places and residuals: same length, same (any) unit each. Between 1 and their number. Deterministic.
double effective_sample_size(const std::vector<Eigen::Vector2d>& places, const std::vector<Eigen::Vector2d>& residuals);

}  // namespace nadir
