// Made by `./run bench fit-likelihood` from tests/estimation/data/looks.bin; never edited by hand: a test fits the same
// looks again and rejects a table that differs. look_likelihood.hpp says what the numbers mean.
// clang-format off
#pragma once

#include "estimation/look_likelihood.hpp"

namespace nadir {

inline constexpr LookLikelihoodTable kLookLikelihoodTable{
    .training = "1160 looks, base seed 1, 0.5 real, 0.4 right, grounds: painted 1; painted 2; painted 3; painted 4; naip 2009 2015; naip 2015 2009; pair 00; pair 02; pair 04; pair 07; pair 09; pair 12; pair 16; pair 20",
    .training_sha256 = "c78f8787a52124d2a1034c84e7a36a91e665b30bc22a3c7dbf8a52fabb8c273a",
    .true_looks = 301,
    .chance_looks = 520,
    .limit = 5.15522,
    .constant = -8.70468165,
    .reference_ln_places = 2.963,
    .curves = {{
        // ratio
        {6, {0.1733, 0.4244, 0.6564, 0.8082, 0.9095, 0.9917}, {2.26480828, 1.83546584, 1.17054417, 0.582862754, 0.308821304, 0}},
        // score
        {6, {0.07798, 0.1221, 0.1719, 0.2622, 0.3804, 0.5844}, {0, 0.503203349, 0.631070758, 1.63026942, 2.65981632, 3.53852874}},
        // inlier_share
        {6, {0.03158, 0.09376, 0.1739, 0.3438, 0.5357, 0.9062}, {0, 0.309045917, 0.346177379, 0.346177379, 0.346177379, 0.346177379}},
        // inliers
        {6, {3, 8, 14, 28, 49, 83}, {0, 0.539772241, 1.27314357, 2.7184562, 3.31449369, 3.31449369}},
        // residual_px
        {6, {0.4571, 1.151, 1.425, 1.611, 1.863, 2.261}, {1.13624782, 1.02766835, 0.855861179, 0.608239207, 0.0957534689, 0}},
        // frame_share
        {6, {0.1256, 0.3584, 0.5725, 0.7955, 0.9965, 1}, {0, 0.375168905, 0.775967982, 1.42409491, 1.42409491, 1.42409491}},
        // deviation_sigmas
        {6, {0.04, 0.254, 0.464, 0.664, 1.093, 2.136}, {0.743174469, 0.743174469, 0.673458598, 0.461749971, 0.461749971, 0}},
        // tilt_sigma_rad
        {3, {0.014, 0.096, 0.35}, {0.168131597, 0, 0}},
        // ln_poses
        {3, {3.356, 4.075, 5.718}, {1.29636091, 0.739741653, 0}},
        // ln_places
        {5, {2.963, 3.137, 4.524, 5.347, 7.452}, {1.88671228, 1.20182577, 0.725855805, 0.222955028, 0}},
    }},
    .ratio_by_places = {6, {0.1733, 0.4244, 0.6564, 0.8082, 0.9095, 0.9917}, {1.22629829, 0.824680423, 0.353928697, 0.273766094, 0, 0}},
    .detection = {{
        {"clear", 264, 0.803, 0.1061},
        {"old", 46, 0.4783, 0.4348},
        {"clouds", 40, 0.35, 0.4},
        {"blur", 46, 0.8478, 0.1304},
        {"night", 33, 0.4242, 0},
    }},
    .chance = {731, 0.6156},
    .numbers_sha256 = "0666587fdc9feeaafba01c3ad92caa22adc6b1451aae93273d58723c9893f89c",
};

}  // namespace nadir
