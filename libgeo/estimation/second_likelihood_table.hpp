// Made by `./run bench matchers --write`; never edited by hand. second_opinion.hpp says what the numbers mean.
// clang-format off
#pragma once

#include "estimation/second_opinion.hpp"

namespace nadir {

inline constexpr SecondLikelihoodTable kSecondLikelihoodTable{
.network_sha256 = "7dd154e1236c16f22f4bdca9ccb0f817a96fc59a2059c3633840f5786b828ed0",
.training = "4868 looks, base seed 41, 0.5 real, 0.4 right, grounds: painted 1; painted 2; painted 3; painted 4; painted 5; painted 6; painted 7; painted 8; naip 2009 2015; naip 2015 2009; pair 00; pair 02; pair 04; pair 07; pair 09; pair 12; pair 16; pair 20",
.look = {
    .training = "4868 looks, base seed 41, 0.5 real, 0.4 right, grounds: painted 1; painted 2; painted 3; painted 4; painted 5; painted 6; painted 7; painted 8; naip 2009 2015; naip 2015 2009; pair 00; pair 02; pair 04; pair 07; pair 09; pair 12; pair 16; pair 20",
    .training_sha256 = "a75417c4f3e21fec31c75990de9ce8e8f15a9d0e6539e4bcb1e7c4cccd9427c4",
    .true_looks = 1189,
    .chance_looks = 3105,
    .limit = 6.94216,
    .constant = -7.3821065,
    .reference_ln_places = 2.963,
    .curves = {{
        // ratio
        {5, {0.5051, 0.7397, 0.862, 0.9419, 1}, {0.203640994, 0.103509043, 0, 0, 0}},
        // score
        {6, {0.2062, 0.3267, 0.4168, 0.5121, 0.5901, 0.7136}, {0, 0.598616838, 1.27870999, 2.52627776, 3.09206655, 3.30130088}},
        // inlier_share
        {6, {0.03846, 0.1, 0.1842, 0.3571, 0.6, 0.9245}, {0, 0.525035197, 0.525035197, 0.900295887, 1.55566078, 2.77914235}},
        // inliers
        {6, {1, 3, 5, 9, 23, 47}, {0, 0.729878812, 1.49057668, 3.47135174, 6.63791343, 8.34293711}},
        // residual_px
        {6, {0.502, 1.613, 1.926, 2.155, 2.394, 2.839}, {0.542583953, 0.542583953, 0.505330763, 0.221044596, 0.190586387, 0}},
        // frame_share
        {6, {0.07788, 0.2202, 0.3407, 0.4871, 0.6706, 0.8731}, {0, 0, 0, 0, 0.5802359, 1.24447057}},
        // shift_px
        {6, {0.2471, 1.141, 2.324, 4.061, 6.641, 13.26}, {0.568313542, 0.531969975, 0.292845903, 0.292845903, 0, 0}},
        // deviation_sigmas
        {5, {0.0058, 0.08541, 0.1732, 0.371, 1.124}, {0.191306219, 0.191306219, 0.191306219, 0.191306219, 0}},
        // tilt_sigma_rad
        {3, {0.01396, 0.09599, 0.35}, {0.133211828, 0.0753526109, 0}},
        // ln_poses
        {3, {3.356, 4.075, 4.999}, {0.484285716, 0.484285716, 0}},
        // ln_places
        {5, {2.963, 3.137, 4.332, 4.524, 5.991}, {0.977562872, 0.977562872, 0.539384063, 0.50700056, 0}},
    }},
    .ratio_by_places = {5, {0.5051, 0.7397, 0.862, 0.9419, 1}, {0.83760504, 0.163282796, 0.0495509967, 0, 0}},
    .detection = {{
        {"clear", 1242, 0.6932, 0.2254},
        {"old", 184, 0.3315, 0.5598},
        {"clouds", 210, 0.1857, 0.7333},
        {"blur", 221, 0.638, 0.2443},
        {"night", 188, 0.4628, 0.4149},
    }},
    .chance = {2823, 0.8629},
    .numbers_sha256 = "27e336f1704807338a1434cadc53d9e5cb4b3d73771a10fb8031cb01ce2d9b4f",
},
.first = {.place = {{{7, 41, 12, 70, 2}, {75, 96, 12, 103, 18}, {644, 132, 16, 116, 34}}}, .chance = {{{2, 195, 142, 1483, 19}, {20, 188, 158, 626, 19}, {2, 14, 6, 17, 2}}}},
.second = {.place = {{{27, 42, 14, 52, 5}, {139, 82, 18, 25, 18}, {639, 53, 11, 28, 36}}}, .chance = {{{3, 201, 1062, 1567, 100}, {3, 30, 35, 80, 18}, {0, 4, 0, 2, 0}}}},
};

}  // namespace nadir
