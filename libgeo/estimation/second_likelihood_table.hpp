// Made by `./run bench matchers --write`; never edited by hand. second_opinion.hpp says what the numbers mean.
// clang-format off
#pragma once

#include "estimation/second_opinion.hpp"

namespace nadir {

inline constexpr SecondLikelihoodTable kSecondLikelihoodTable{
.network_sha256 = "7dd154e1236c16f22f4bdca9ccb0f817a96fc59a2059c3633840f5786b828ed0",
.training = "540 looks, base seed 41, 0.5 real, 0.4 right, grounds: painted 1; painted 2; painted 3; painted 4; naip 2009 2015; naip 2015 2009; pair 00; pair 02; pair 04; pair 07; pair 09; pair 12; pair 16; pair 20",
.look = {
    .training = "540 looks, base seed 41, 0.5 real, 0.4 right, grounds: painted 1; painted 2; painted 3; painted 4; naip 2009 2015; naip 2015 2009; pair 00; pair 02; pair 04; pair 07; pair 09; pair 12; pair 16; pair 20",
    .training_sha256 = "9cd9664bc0caf0eaf4bea0d306431abc527470881e0a6535f79d4936507fe3c3",
    .true_looks = 134,
    .chance_looks = 345,
    .limit = 4.74493,
    .constant = -6.58539106,
    .reference_ln_places = 2.963,
    .curves = {{
        // ratio
        {5, {0.5104, 0.7457, 0.87, 0.9459, 1}, {0.380855889, 0.1583683, 0.081823445, 0.0637842839, 0}},
        // score
        {6, {0.2081, 0.3255, 0.4219, 0.4908, 0.5726, 0.6816}, {0, 0.652696203, 1.42805657, 2.06114979, 2.63198558, 2.63198558}},
        // inlier_share
        {6, {0.03922, 0.09804, 0.1786, 0.35, 0.5692, 0.875}, {0, 0.303955258, 0.726920718, 0.965026225, 1.17931281, 1.32102003}},
        // inliers
        {6, {1, 3, 5, 9, 22, 43}, {0, 0.214933489, 1.04718778, 2.24410861, 3.511315, 4.37547581}},
        // residual_px
        {6, {0.4525, 1.636, 1.921, 2.165, 2.382, 2.87}, {0.902187081, 0.685047273, 0.467600701, 0.467600701, 0.467600701, 0}},
        // frame_share
        {6, {0.07453, 0.2136, 0.3392, 0.476, 0.6581, 0.8707}, {0, 0, 0, 0.523198923, 1.18891836, 1.75757073}},
        // shift_px
        {6, {0.2318, 1.098, 2.301, 3.891, 6.8, 12.38}, {1.53496443, 1.40024269, 0.978315876, 0.434491918, 0.215150388, 0}},
        // deviation_sigmas
        {5, {0.00516, 0.08281, 0.1776, 0.4503, 1.124}, {0, 0, 0, 0, 0}},
        // tilt_sigma_rad
        {3, {0.01396, 0.09599, 0.35}, {0.702444537, 0.616015199, 0}},
        // ln_poses
        {3, {3.356, 4.075, 6.361}, {0.0556033978, 0.0556033978, 0}},
        // ln_places
        {4, {2.963, 3.137, 4.524, 5.991}, {0.594119891, 0.464890835, 0, 0}},
    }},
    .ratio_by_places = {5, {0.5104, 0.7457, 0.87, 0.9459, 1}, {0.414655663, 0.188311531, 0.0822574361, 0.0822574361, 0}},
    .detection = {{
        {"clear", 127, 0.685, 0.2126},
        {"old", 29, 0.4138, 0.4828},
        {"clouds", 24, 0.08333, 0.9167},
        {"blur", 34, 0.6176, 0.3235},
        {"night", 21, 0.5714, 0.3333},
    }},
    .chance = {305, 0.8656},
    .numbers_sha256 = "22a7fcbea7e70ac3faba4f66487bf0d2da9cf0dfdd26fecd82469ee49622b455",
},
.first = {.place = {{{0, 5, 1, 9, 0}, {9, 13, 4, 10, 5}, {65, 19, 2, 13, 3}}}, .chance = {{{0, 24, 11, 178, 0}, {8, 150, 115, 472, 9}, {1, 8, 3, 11, 1}}}},
.second = {.place = {{{5, 6, 2, 5, 0}, {19, 11, 2, 8, 1}, {63, 6, 1, 2, 3}}}, .chance = {{{0, 23, 103, 182, 10}, {1, 5, 4, 13, 3}, {0, 1, 0, 0, 0}}}},
};

}  // namespace nadir
