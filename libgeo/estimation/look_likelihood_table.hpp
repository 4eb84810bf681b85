// Made by `./run bench fit-likelihood` from tests/estimation/data/looks.bin; never edited by hand: a test fits the same
// looks again and rejects a table that differs. look_likelihood.hpp says what the numbers mean.
// clang-format off
#pragma once

#include "estimation/look_likelihood.hpp"

namespace nadir {

inline constexpr LookLikelihoodTable kLookLikelihoodTable{
    .training = "1146 looks, base seed 1, 0.5 real, 0.35 right, grounds: painted 1; painted 2; painted 3; painted 4; naip 2009 2015; naip 2015 2009; pair 00; pair 02; pair 04; pair 07; pair 09; pair 12; pair 16; pair 20",
    .training_sha256 = "2c611e0963c210a27e8bbdd8ddb059a37b94b81ab8216e1edda29f309145a005",
    .true_looks = 254,
    .chance_looks = 532,
    .limit = 5.17803,
    .constant = -9.80606029,
    .reference_ln_places = 2.963,
    .curves = {{
        // ratio
        {6, {0.1788, 0.4081, 0.6494, 0.7931, 0.91, 0.9901}, {3.48105609, 2.79928735, 1.94367904, 1.21793921, 0.60612595, 0}},
        // score
        {6, {0.07546, 0.1201, 0.1689, 0.2584, 0.379, 0.583}, {0, 0.672332758, 1.16043963, 2.21276309, 2.98547824, 3.58371149}},
        // inlier_share
        {6, {0.03124, 0.08452, 0.1667, 0.3438, 0.5417, 0.9167}, {0, 0.264457372, 0.371435296, 0.486146213, 0.486146213, 0.486146213}},
        // inliers
        {6, {3, 7, 13, 28, 49, 83}, {0, 0.456228389, 1.17706517, 2.50091522, 3.45897956, 3.87945636}},
        // residual_px
        {6, {0.5304, 1.141, 1.411, 1.609, 1.863, 2.242}, {1.268048, 1.10577781, 0.877544735, 0.630507909, 0.401254147, 0}},
        // frame_share
        {5, {0.1057, 0.349, 0.5494, 0.7948, 1}, {0, 0.227804192, 0.541919083, 1.19679868, 1.49119583}},
        // shift_px
        {6, {0.14, 0.61, 1.38, 2.62, 4.83, 10.91}, {0.392753086, 0.378787478, 0.0899037142, 0.0899037142, 0.0899037142, 0}},
        // deviation_sigmas
        {6, {0.049, 0.242, 0.438, 0.629, 1.017, 1.972}, {0.621768148, 0.621768148, 0.620724895, 0.254886416, 0, 0}},
        // tilt_sigma_rad
        {3, {0.014, 0.096, 0.35}, {0.415950941, 0.10637803, 0}},
        // ln_poses
        {3, {3.356, 4.075, 4.999}, {1.44150293, 0.796407835, 0}},
        // ln_places
        {5, {2.963, 3.137, 4.465, 4.524, 5.991}, {2.2332947, 0.973178058, 0.737826351, 0.528416604, 0}},
    }},
    .ratio_by_places = {6, {0.1788, 0.4081, 0.6494, 0.7931, 0.91, 0.9901}, {0.953207184, 0.7521087, 0.371994359, 0.231285486, 0, 0}},
    .detection = {{
        {"clear", 223, 0.8072, 0.1031},
        {"old", 41, 0.4878, 0.4146},
        {"clouds", 34, 0.3235, 0.4412},
        {"blur", 37, 0.8649, 0.1351},
        {"night", 27, 0.4074, 0},
    }},
    .chance = {784, 0.602},
    .numbers_sha256 = "e524364f598dcfc9fd7e1568dbb25fad86ea024b802dd52206242acbc0ce8cf3",
};

}  // namespace nadir
