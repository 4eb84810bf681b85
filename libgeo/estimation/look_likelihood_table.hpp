// Made by `./run bench fit-likelihood` from tests/estimation/data/looks.bin; never edited by hand: a test fits the same
// looks again and rejects a table that differs. look_likelihood.hpp says what the numbers mean.
// clang-format off
#pragma once

#include "estimation/look_likelihood.hpp"

namespace nadir {

inline constexpr LookLikelihoodTable kLookLikelihoodTable{
    .training = "8106 looks, base seed 1, 0.5 real, 0.35 right, grounds: painted 1; painted 2; painted 3; painted 4; naip 2009 2015; naip 2015 2009; pair 00; pair 02; pair 04; pair 07; pair 09; pair 12; pair 16; pair 20",
    .training_sha256 = "c79c47d7e16dc8aafd39df194b919f95737d99cc1aa45896c905d26d0ebe94b1",
    .true_looks = 1897,
    .chance_looks = 3528,
    .limit = 7.06987,
    .constant = -9.92626463,
    .reference_ln_places = 2.963,
    .curves = {{
        // ratio
        {6, {0.179, 0.4214, 0.6373, 0.8013, 0.9122, 0.9925}, {3.06233381, 2.75107207, 1.74789637, 1.05555286, 0.403632962, 0}},
        // score
        {6, {0.0731, 0.1197, 0.1678, 0.2581, 0.3779, 0.5735}, {0, 0.753291419, 0.985788932, 2.31908275, 3.720401, 4.8424293}},
        // inlier_share
        {6, {0.03124, 0.08334, 0.1667, 0.3438, 0.5729, 0.9271}, {0, 0.704624348, 0.847200519, 0.847200519, 0.847200519, 0.847200519}},
        // inliers
        {6, {3, 7, 13, 28, 49, 83}, {0, 0.614484201, 1.63479406, 3.30700671, 4.8946948, 6.05205979}},
        // residual_px
        {6, {0.4571, 1.127, 1.409, 1.627, 1.863, 2.243}, {2.16057969, 1.21916831, 0.936430722, 0.629783632, 0.629783632, 0}},
        // frame_share
        {5, {0.127, 0.3503, 0.559, 0.7952, 0.9935}, {0, 0.0335839624, 0.0335839624, 0.0335839624, 0.0335839624}},
        // shift_px
        {6, {0.14, 0.6, 1.34, 2.68, 5.02, 11.23}, {0.28326227, 0.28326227, 0.0829988462, 0, 0, 0}},
        // deviation_sigmas
        {6, {0.049, 0.246, 0.448, 0.67, 1.02, 2.099}, {0.519445827, 0.519445827, 0.519445827, 0.519445827, 0.519445827, 0}},
        // tilt_sigma_rad
        {3, {0.014, 0.096, 0.35}, {0.583465539, 0.583465539, 0}},
        // ln_poses
        {3, {3.356, 4.075, 5.718}, {0.448163814, 0.252229004, 0}},
        // ln_places
        {4, {2.963, 3.137, 4.512, 6.733}, {2.52243867, 1.45842393, 0.859544849, 0}},
    }},
    .ratio_by_places = {6, {0.179, 0.4214, 0.6373, 0.8013, 0.9122, 0.9925}, {1.48204729, 1.12978827, 0.406173938, 0.242711928, 0, 0}},
    .detection = {{
        {"clear", 1689, 0.7715, 0.09947},
        {"old", 294, 0.551, 0.3673},
        {"clouds", 289, 0.2872, 0.5398},
        {"blur", 290, 0.769, 0.1345},
        {"night", 265, 0.4755, 0.03396},
    }},
    .chance = {5279, 0.5774},
    .numbers_sha256 = "63e1b7feebdb50521ba7a63b71dc568227bb7c6ffac043efc9dd009f42344344",
};

}  // namespace nadir
