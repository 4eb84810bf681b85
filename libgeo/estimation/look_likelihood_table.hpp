// Made by `./run bench fit-likelihood` from tests/estimation/data/looks.bin; never edited by hand: a test fits the same
// looks again and rejects a table that differs. look_likelihood.hpp says what the numbers mean.
// clang-format off
#pragma once

#include "estimation/look_likelihood.hpp"

namespace nadir {

inline constexpr LookLikelihoodTable kLookLikelihoodTable{
    .training = "8106 looks, base seed 1, 0.5 real, 0.35 right, grounds: painted 1; painted 2; painted 3; painted 4; naip 2009 2015; naip 2015 2009; pair 00; pair 02; pair 04; pair 07; pair 09; pair 12; pair 16; pair 20",
    .training_sha256 = "4b738d7739e90258aa48714488d8cd2c2de12eb825c847fd5d7ee78042256012",
    .true_looks = 1889,
    .chance_looks = 3536,
    .limit = 7.07214,
    .constant = -9.85929572,
    .reference_ln_places = 2.963,
    .curves = {{
        // ratio
        {6, {0.179, 0.4205, 0.6364, 0.8009, 0.9118, 0.9925}, {2.94691891, 2.76219801, 1.78788416, 1.09547476, 0.434274411, 0}},
        // score
        {6, {0.0731, 0.1199, 0.1681, 0.2587, 0.3785, 0.5735}, {0, 0.833118688, 1.11282116, 2.46835949, 3.92298697, 5.18438893}},
        // inlier_share
        {6, {0.03124, 0.08334, 0.1667, 0.3438, 0.5733, 0.9271}, {0, 0.651403217, 0.760977794, 0.760977794, 0.760977794, 0.760977794}},
        // inliers
        {6, {3, 7, 13, 28, 49, 83}, {0, 0.609560153, 1.59520137, 3.28523445, 4.45058542, 4.72439714}},
        // residual_px
        {6, {0.4571, 1.127, 1.408, 1.627, 1.863, 2.242}, {2.22682203, 1.29572723, 0.889891271, 0.698457838, 0.698457838, 0}},
        // frame_share
        {5, {0.127, 0.3506, 0.5593, 0.7953, 0.994}, {0, 0.0215174184, 0.0215174184, 0.0215174184, 0.0215174184}},
        // shift_px
        {6, {0.14, 0.6, 1.33, 2.66, 5.01, 11.23}, {0.367411433, 0.367411433, 0.0888750682, 0.0077689512, 0, 0}},
        // deviation_sigmas
        {6, {0.049, 0.246, 0.448, 0.67, 1.02, 2.105}, {0.482704152, 0.482704152, 0.482704152, 0.482704152, 0.482704152, 0}},
        // tilt_sigma_rad
        {3, {0.014, 0.096, 0.35}, {0.577713967, 0.577713967, 0}},
        // ln_poses
        {3, {3.356, 4.075, 5.718}, {0.424915975, 0.252793408, 0}},
        // ln_places
        {4, {2.963, 3.137, 4.512, 6.733}, {2.27160114, 1.38143074, 0.806720821, 0}},
    }},
    .ratio_by_places = {6, {0.179, 0.4205, 0.6364, 0.8009, 0.9118, 0.9925}, {1.36208369, 1.12193545, 0.395806432, 0.206479364, 0, 0}},
    .detection = {{
        {"clear", 1682, 0.7705, 0.09988},
        {"old", 294, 0.551, 0.3673},
        {"clouds", 289, 0.2872, 0.5398},
        {"blur", 289, 0.7682, 0.1349},
        {"night", 265, 0.4755, 0.03396},
    }},
    .chance = {5287, 0.578},
    .numbers_sha256 = "02ae3708c33200baa0107bf153248df78bbb8bd1a003ab14bdf2f4bde510f581",
};

}  // namespace nadir
