// Made by `./run bench matchers --write`; never edited by hand. second_opinion.hpp says what the numbers mean.
// clang-format off
#pragma once

#include "estimation/second_opinion.hpp"

namespace nadir {

inline constexpr SecondLikelihoodTable kSecondLikelihoodTable{
.network_sha256 = "7dd154e1236c16f22f4bdca9ccb0f817a96fc59a2059c3633840f5786b828ed0",
.training = "800 looks, base seed 41, 0.5 real, 0.4 right, grounds: painted 1; painted 2; painted 3; painted 4; naip 2009 2015; naip 2015 2009; pair 00; pair 02; pair 04; pair 07; pair 09; pair 12; pair 16; pair 20",
.look = {
    .training = "800 looks, base seed 41, 0.5 real, 0.4 right, grounds: painted 1; painted 2; painted 3; painted 4; naip 2009 2015; naip 2015 2009; pair 00; pair 02; pair 04; pair 07; pair 09; pair 12; pair 16; pair 20",
    .training_sha256 = "d400d1a456692277c8ace24f5d02413a0f4b0ba56d8402b5b7a10ad357f739f6",
    .true_looks = 192,
    .chance_looks = 505,
    .limit = 5.12595,
    .constant = -6.54355635,
    .reference_ln_places = 2.963,
    .curves = {{
        // ratio
        {5, {0.487, 0.7387, 0.863, 0.9455, 1}, {0.360655825, 0, 0, 0, 0}},
        // score
        {6, {0.202, 0.3302, 0.4101, 0.4915, 0.5794, 0.7051}, {0, 0.361535639, 0.839575852, 1.74303864, 2.42234439, 2.55072322}},
        // inlier_share
        {6, {0.04, 0.1, 0.1818, 0.3559, 0.5918, 0.9153}, {0, 0.413031569, 0.913451277, 1.34035455, 1.52779516, 1.7764621}},
        // inliers
        {5, {2, 5, 9, 22, 43}, {0, 1.1392762, 3.0509109, 4.63801328, 5.57720802}},
        // residual_px
        {6, {0.6488, 1.669, 1.991, 2.213, 2.421, 2.886}, {0.955623975, 0.955623975, 0.802722644, 0.597521824, 0.470699102, 0}},
        // frame_share
        {6, {0.09152, 0.2258, 0.3484, 0.4957, 0.6712, 0.8638}, {0, 0.143710667, 0.143710667, 0.743657118, 1.63485917, 2.19073616}},
        // shift_px
        {6, {0.208, 1.111, 2.152, 4.077, 6.5, 11.42}, {0.459988525, 0.335973177, 0.228974437, 0, 0, 0}},
        // deviation_sigmas
        {6, {0.00756, 0.04179, 0.08963, 0.1716, 0.3812, 1.112}, {0, 0, 0, 0, 0, 0}},
        // tilt_sigma_rad
        {3, {0.01396, 0.09599, 0.35}, {0.131610854, 0.131610854, 0}},
        // ln_poses
        {3, {3.356, 4.075, 6.361}, {0.15017838, 0.0512789448, 0}},
        // ln_places
        {4, {2.963, 3.137, 4.477, 5.991}, {0.782869998, 0.782869998, 0.273096408, 0}},
    }},
    .ratio_by_places = {5, {0.487, 0.7387, 0.863, 0.9455, 1}, {1.05897431, 0.396832593, 0.0816191541, 0, 0}},
    .detection = {{
        {"clear", 193, 0.658, 0.2383},
        {"old", 41, 0.3659, 0.5854},
        {"clouds", 33, 0.06061, 0.9091},
        {"blur", 47, 0.5957, 0.3404},
        {"night", 35, 0.5714, 0.2571},
    }},
    .chance = {451, 0.8426},
    .numbers_sha256 = "899be24dc4e7d57ed8f8be333e02ade1e9c2707ac4d61b68fdf8194b359a248b",
},
.first = {.place = {{{1, 6, 1, 18, 0}, {16, 16, 5, 18, 7}, {90, 27, 2, 20, 6}}}, .chance = {{{0, 38, 19, 250, 3}, {1, 6, 4, 11, 1}, {0, 0, 0, 0, 0}}}},
.second = {.place = {{{5, 6, 3, 5, 1}, {28, 13, 3, 7, 4}, {89, 12, 2, 9, 5}}}, .chance = {{{1, 38, 152, 265, 17}, {1, 7, 2, 17, 4}, {0, 1, 0, 0, 0}}}},
};

}  // namespace nadir
