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
    .constant = -9.92286336,
    .reference_ln_places = 2.963,
    .curves = {{
        // ratio
        {6, {0.179, 0.4205, 0.6364, 0.8009, 0.9118, 0.9925}, {2.91334092, 2.73605978, 1.76346541, 1.07669752, 0.436420003, 0}},
        // score
        {6, {0.0731, 0.1199, 0.1681, 0.2587, 0.3785, 0.5735}, {0, 0.833045974, 1.11672836, 2.48067514, 3.94249062, 5.20226225}},
        // inlier_share
        {6, {0.03124, 0.08334, 0.1667, 0.3438, 0.5733, 0.9271}, {0, 0.667150633, 0.78337682, 0.78337682, 0.78337682, 0.78337682}},
        // inliers
        {6, {3, 7, 13, 28, 49, 83}, {0, 0.603771122, 1.58407116, 3.27105637, 4.43708503, 4.71252661}},
        // residual_px
        {6, {0.4571, 1.127, 1.408, 1.627, 1.863, 2.242}, {2.23020666, 1.31293112, 0.902299997, 0.706078361, 0.706078361, 0}},
        // frame_share
        {6, {0.127, 0.3506, 0.5593, 0.7953, 0.994, 1}, {0, 0.0457940457, 0.0457940457, 0.0457940457, 0.0457940457, 0.0457940457}},
        // shift_px
        {6, {0.14, 0.6, 1.33, 2.66, 5.01, 11.23}, {0.360778786, 0.360778786, 0.085348295, 0.00540473595, 0, 0}},
        // deviation_sigmas
        {6, {0.049, 0.246, 0.448, 0.67, 1.02, 2.105}, {0.479721782, 0.479721782, 0.479721782, 0.479721782, 0.479721782, 0}},
        // tilt_sigma_rad
        {3, {0.014, 0.096, 0.35}, {0.574132289, 0.574132289, 0}},
        // ln_poses
        {3, {3.356, 4.075, 5.718}, {0.444953368, 0.264001319, 0}},
        // ln_places
        {5, {2.963, 3.137, 4.512, 4.524, 6.733}, {2.27965457, 1.40713948, 1.28447163, 0.723946288, 0}},
    }},
    .ratio_by_places = {6, {0.179, 0.4205, 0.6364, 0.8009, 0.9118, 0.9925}, {1.29929815, 1.10759318, 0.413322498, 0.228346019, 0, 0}},
    .detection = {{
        {"clear", 1682, 0.7705, 0.09988},
        {"old", 294, 0.551, 0.3673},
        {"clouds", 289, 0.2872, 0.5398},
        {"blur", 289, 0.7682, 0.1349},
        {"night", 265, 0.4755, 0.03396},
    }},
    .chance = {5287, 0.578},
    .numbers_sha256 = "fabe57b588dcb79e05ea6e3db6ec2403fd043749e769d95a546013de5bc6dc53",
};

}  // namespace nadir
