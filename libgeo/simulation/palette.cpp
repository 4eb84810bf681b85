#include "simulation/palette.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace nadir {
namespace {

double linear(int value) {
  const double v = value / 255.0;
  return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
}

struct SeasonalAppearances {
  CropAppearance may, september;
};

Light rgb(int r, int g, int b) { return light_from_srgb(r, g, b); }

const SeasonalAppearances& appearances_of(Crop crop) {
  // colour, second, rows, row_m, passes, mottle, tramlines, grain
  static const std::array<SeasonalAppearances, 14> table = {{
      {{rgb(84, 110, 58), rgb(112, 122, 74), .05, 1.6, .05, .10, .9, .06},      // wheat: green …
       {rgb(186, 168, 126), rgb(150, 130, 96), .10, 3.1, .10, .10, .35, .08}},  // … stubble
      {{rgb(126, 140, 80), rgb(138, 140, 92), .04, 1.6, .05, .12, .9, .06},     // barley: pale green …
       {rgb(118, 98, 78), rgb(140, 118, 94), .10, 2.2, .10, .20, 0, .10}},      // … ploughed
      {{rgb(196, 186, 74), rgb(150, 156, 72), .03, 1.6, .04, .10, .7, .06},     // rapeseed in flower …
       {rgb(140, 128, 92), rgb(112, 120, 72), .08, 3.1, .08, .22, .3, .10}},    // … stubble with volunteers
      {{rgb(158, 134, 106), rgb(136, 114, 88), .10, 2.2, .07, .24, .2, .08},    // maize: drilled soil …
       {rgb(82, 100, 54), rgb(112, 116, 70), .12, 1.5, .05, .08, .15, .10}},    // … tall
      {{rgb(146, 124, 98), rgb(118, 120, 78), .14, 1.8, .06, .20, .5, .08},     // beet: rows on soil …
       {rgb(96, 126, 60), rgb(124, 128, 76), .10, 1.8, .06, .14, .5, .08}},     // … closed
      {{rgb(150, 130, 104), rgb(126, 112, 86), .10, 2.4, .08, .20, .3, .08},    // sunflower
       {rgb(112, 102, 66), rgb(92, 84, 60), .12, 1.5, .05, .12, .2, .12}},
      {{rgb(80, 112, 56), rgb(106, 126, 70), .03, 3, .06, .08, .3, .05},  // alfalfa
       {rgb(94, 118, 62), rgb(132, 134, 86), .05, 3, .12, .10, .2, .06}},
      {{rgb(104, 130, 66), rgb(122, 140, 78), .04, 2.4, .08, .10, 0, .06},  // meadow
       {rgb(122, 130, 78), rgb(150, 146, 98), .05, 3.2, .12, .14, 0, .07}},
      {{rgb(108, 130, 70), rgb(132, 138, 88), 0, 3, 0, .16, 0, .08},  // pasture
       {rgb(124, 126, 80), rgb(156, 146, 104), 0, 3, 0, .20, 0, .09}},
      {{rgb(126, 130, 86), rgb(102, 120, 68), 0, 3, .02, .26, 0, .13},  // fallow
       {rgb(146, 136, 96), rgb(112, 112, 70), 0, 3, .02, .28, 0, .15}},
      {{rgb(150, 136, 108), rgb(96, 112, 64), .34, 2.4, .06, .12, 0, .08},  // vineyard
       {rgb(142, 128, 96), rgb(78, 98, 50), .55, 2.4, .05, .10, 0, .08}},
      {{rgb(112, 132, 72), rgb(132, 140, 86), .08, 7.5, .03, .14, 0, .07},  // orchard: the grass
       {rgb(126, 130, 82), rgb(148, 142, 98), .08, 7.5, .03, .16, 0, .08}},
      {{rgb(66, 78, 46), rgb(82, 86, 56), 0, 3, 0, .15, 0, .10},  // wood: the floor
       {rgb(60, 66, 42), rgb(80, 76, 52), 0, 3, 0, .15, 0, .10}},
      {{rgb(58, 64, 44), rgb(72, 70, 50), 0, 3, 0, .15, 0, .10},  // conifers
       {rgb(56, 60, 42), rgb(70, 66, 48), 0, 3, 0, .15, 0, .10}},
  }};
  return table[static_cast<std::size_t>(crop)];
}

}  // namespace

Light light_from_srgb(int red, int green, int blue) { return {linear(blue), linear(green), linear(red)}; }

std::uint8_t srgb_from_light(double light) {
  static const std::array<std::uint8_t, 4096> table = [] {
    std::array<std::uint8_t, 4096> result{};
    for (std::size_t i = 0; i < result.size(); ++i) {
      const double v = (static_cast<double>(i) + 0.5) / 4096;
      const double s = v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055;
      result[i] = static_cast<std::uint8_t>(std::lround(255 * s));
    }
    return result;
  }();
  return table[static_cast<std::size_t>(std::clamp(light * 4096, 0.0, 4095.0))];
}

CropAppearance appearance_of(const Parcel& parcel, Season season) {
  const bool may = season == Season::may;
  const Crop crop = may ? parcel.crop_before : parcel.crop;
  CropAppearance appearance = may ? appearances_of(crop).may : appearances_of(crop).september;
  const double tone = 1 + 0.14 * parcel.tone;
  // Every farmer's field is a little warmer or greener, and after the harvest some are worked and some are not.
  const double warm = 0.10 * (unit_hash(parcel.seed, 3) - 0.5);
  if (!may && (crop == Crop::wheat || crop == Crop::rapeseed) && unit_hash(parcel.seed, 11) < 0.3) {
    std::swap(appearance.colour, appearance.second);
    appearance.mottle += 0.06;
  }
  if (crop == Crop::meadow && unit_hash(parcel.seed, may ? 12 : 13) < 0.4) {  // just mown
    appearance.colour = appearance.colour * 0.4 + rgb(158, 156, 104) * 0.6;
    appearance.passes += 0.08;
  }
  const Light tint(tone * (1 - warm), tone, tone * (1 + warm));
  appearance.colour = appearance.colour.mul(tint);
  appearance.second = appearance.second.mul(tint);
  return appearance;
}

Light roof_colour(Roof roof) {
  switch (roof) {
    case Roof::tiles: return rgb(168, 104, 80);
    case Roof::brown: return rgb(122, 92, 78);
    case Roof::slate: return rgb(98, 100, 106);
    case Roof::metal: return rgb(176, 180, 182);
    case Roof::flat: return rgb(150, 148, 142);
    case Roof::round: return rgb(200, 202, 200);
  }
  return {};
}

Light cover_colour(Cover cover, Season season) {
  const bool may = season == Season::may;
  switch (cover) {
    case Cover::lawn: return may ? rgb(106, 132, 70) : rgb(116, 130, 78);
    case Cover::beds: return may ? rgb(132, 116, 92) : rgb(98, 108, 66);
    case Cover::gravel: return rgb(178, 168, 148);
    case Cover::paving: return rgb(158, 154, 148);
    case Cover::pitch: return may ? rgb(98, 130, 70) : rgb(106, 132, 74);
    case Cover::wild: return may ? rgb(110, 126, 76) : rgb(128, 126, 84);
  }
  return {};
}

Light tree_colour(const Tree& tree, Season season) {
  const bool may = season == Season::may;
  Light colour;
  switch (tree.plant) {
    case Plant::broadleaf: colour = may ? rgb(86, 114, 54) : rgb(80, 96, 50); break;
    case Plant::conifer: colour = rgb(56, 76, 50); break;
    case Plant::bush: colour = may ? rgb(88, 112, 58) : rgb(92, 100, 58); break;
    case Plant::fruit: colour = may ? rgb(108, 130, 74) : rgb(86, 104, 56); break;
    case Plant::bale: colour = rgb(206, 186, 136); break;
  }
  const double warm = 0.16 * (unit_hash(tree.seed, 1) - 0.5);
  const double autumn = !may && tree.plant == Plant::broadleaf && unit_hash(tree.seed, 2) < 0.12 ? 0.35 : 0;
  const double tone = 1 + 0.18 * tree.tone;
  return colour.mul(Light(tone * (1 - warm - autumn * 0.4), tone, tone * (1 + warm + autumn)));
}

}  // namespace nadir
