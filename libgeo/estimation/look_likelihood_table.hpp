// Made by `./run bench fit-likelihood` from tests/estimation/data/looks.bin; never edited by hand: a test fits the same
// looks again and rejects a table that differs. look_likelihood.hpp says what the numbers mean.
// clang-format off
#pragma once

#include "estimation/look_likelihood.hpp"

namespace nadir {

inline constexpr LookLikelihoodTable kLookLikelihoodTable{
    .training = "8106 looks, base seed 1, 0.5 real, 0.35 right, grounds: painted 1; painted 2; painted 3; painted 4; naip 2009 2015; naip 2015 2009; pair 00; pair 02; pair 04; pair 07; pair 09; pair 12; pair 16; pair 20 | 30000 looks, base seed 21, 0.5 real, 0.2 right, grounds: painted 1; painted 2; painted 3; painted 4; painted 5; painted 6; painted 7; painted 8; naip 2009 2015; naip 2015 2009; pair 00; pair 02; pair 04; pair 07; pair 09; pair 12; pair 16; pair 20",
    .training_sha256 = "b96b88aa3dd4b60becf748ce17ed5d64641a1e23e6ad1a2a0620c944005d8822",
    .true_looks = 6015,
    .chance_looks = 18438,
    .limit = 8.72356,
    .constant = -9.40593061,
    .reference_ln_places = 2.963,
    .curves = {{
        // ratio
        {6, {0.1798, 0.42, 0.635, 0.8031, 0.9125, 0.9932}, {2.90664648, 2.50709626, 1.44899474, 0.766666026, 0.33004347, 0}},
        // score
        {6, {0.07266, 0.1186, 0.1651, 0.2569, 0.3794, 0.5784}, {0, 0.678056607, 0.983179418, 2.19304984, 3.76777736, 5.27483487}},
        // inlier_share
        {6, {0.03124, 0.08334, 0.1622, 0.3333, 0.5729, 0.9385}, {0, 0.34360686, 0.34360686, 0.34360686, 0.34360686, 0.34360686}},
        // inliers
        {6, {3, 7, 13, 27, 49, 83}, {0, 0.718998166, 1.69028228, 3.2750755, 5.49472777, 7.0842492}},
        // residual_px
        {6, {0.4303, 1.118, 1.397, 1.619, 1.854, 2.254}, {2.15123183, 1.08175616, 0.83306337, 0.588727807, 0.304513157, 0}},
        // frame_share
        {5, {0.1267, 0.3513, 0.5605, 0.7939, 0.9934}, {0, 0.123867351, 0.239158186, 0.239158186, 0.239158186}},
        // shift_px
        {6, {0.15, 0.6, 1.36, 2.73, 5.03, 11.5}, {0.513728871, 0.491772176, 0.120719935, 0.0743067947, 0.0557448651, 0}},
        // deviation_sigmas
        {6, {0.047, 0.249, 0.444, 0.674, 1.036, 2.012}, {0.853025727, 0.853025727, 0.853025727, 0.853025727, 0.794269802, 0}},
        // tilt_sigma_rad
        {3, {0.014, 0.096, 0.35}, {0.211425375, 0.139147562, 0}},
        // ln_poses
        {3, {3.356, 4.075, 5.718}, {0.479468363, 0.302273225, 0}},
        // ln_places
        {4, {2.963, 3.137, 4.487, 6.387}, {2.35428394, 1.61050605, 0.948231213, 0}},
    }},
    .ratio_by_places = {6, {0.1798, 0.42, 0.635, 0.8031, 0.9125, 0.9932}, {1.29255078, 0.966457288, 0.447411622, 0.18567105, 0, 0}},
    .detection = {{
        {"clear", 5349, 0.7815, 0.09628},
        {"old", 874, 0.5584, 0.3799},
        {"clouds", 891, 0.2795, 0.5679},
        {"blur", 885, 0.7684, 0.1311},
        {"night", 843, 0.4958, 0.05219},
    }},
    .chance = {29264, 0.5784},
    .numbers_sha256 = "7e4c3775bb862a5c0ad329908f43c5bf14af531f242ced8d979c1952c29d4d43",
};

}  // namespace nadir
