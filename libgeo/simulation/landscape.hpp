// A synthetic landscape as a description without pixels: relief, river, roads, fields, buildings, trees. The painter
// (painter.hpp) renders it for any season and sun.
//
// Coordinates are metres east (x) and north (y) of the world's south-west corner; heights are metres above the
// ellipsoid. Everything follows from the seed. Fields are cells of a recursive subdivision of a gently warped plane (u,
// v): straight there, curved on the ground, and their crop rows curve with them.
#pragma once

#include <array>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "simulation/noise.hpp"

namespace nadir {

using GroundPoint = cv::Point2d;

enum class Crop : std::uint8_t {
  wheat,
  barley,
  rapeseed,
  maize,
  beet,
  sunflower,
  alfalfa,
  meadow,
  pasture,
  fallow,
  vineyard,
  orchard,
  wood,
  conifers
};
inline constexpr int kArableCrops = 7;  // the first ones, which are sown anew each year

enum class Border : std::uint8_t { road, track, hedge, grass, furrow };

// A cut through the plane: u·normal = offset.
struct Cut {
  GroundPoint normal;
  double offset = 0;
  Border border = Border::furrow;
  double half_width_m = 0.4;
  std::array<int, 2> below{};  // child on the negative and the positive side: ≥ 0 a cut, < 0 parcel −1 − value
};

struct Parcel {
  Crop crop = Crop::wheat;         // on the day of the flight
  Crop crop_before = Crop::wheat;  // at the time of the satellite image
  double row_angle_rad = 0;        // direction of the rows in (u, v)
  double tone = 0;                 // −1…1: deviation of this field from others of its crop
  double half_done = 2;            // fraction along the rows that is already ploughed on the day; > 1: none
  GroundPoint centre;              // in (u, v)
  double length_m = 0;             // along the rows
  double area_m2 = 0;
  std::uint64_t seed = 0;
};

struct FieldPattern {
  Noise warp_x{0, 1}, warp_y{0, 1};
  double warp_m = 0;
  std::vector<Cut> cuts;  // cuts[0] is the root
  std::vector<Parcel> parcels;

  GroundPoint uv_from_ground(GroundPoint ground) const;
  GroundPoint ground_from_uv(GroundPoint uv) const;

  struct Hit {
    int parcel = 0;
    int nearest_cut = -1;
    double border_m = 1e9;  // distance to the nearest cut, less its half width; negative on it
    double road_m = 1e9;    // the same for the nearest cut that is a road
    double track_m = 1e9;
  };
  Hit find(GroundPoint uv) const;
};

// A polyline of varying width: rivers, roads, streets.
struct Polyline {
  std::vector<GroundPoint> points;
  std::vector<double> half_widths_m;
};
double distance_m(const Polyline& line, GroundPoint position);  // to its centre line

struct Pond {
  GroundPoint centre;
  double radius_m = 0;
  std::uint64_t seed = 0;
  double edge_m(GroundPoint position) const;  // negative inside
};

enum class Presence : std::uint8_t { both, before_only, day_only };

enum class Roof : std::uint8_t { tiles, brown, slate, metal, flat, round };

struct Building {
  GroundPoint centre;
  double angle_rad = 0;  // of the ridge
  double length_m = 0;   // along the ridge
  double width_m = 0;
  double eaves_m = 0;
  double ridge_m = 0;  // equal to the eaves: flat
  Roof roof = Roof::tiles;
  Roof roof_before = Roof::tiles;
  double tone = 0;
  Presence presence = Presence::both;
};

enum class Cover : std::uint8_t { lawn, beds, gravel, paving, pitch, wild };

struct Plot {  // a rectangle of garden, yard or pavement
  GroundPoint centre;
  double angle_rad = 0;
  double length_m = 0;
  double width_m = 0;
  Cover cover = Cover::lawn;
  double tone = 0;
};

enum class Plant : std::uint8_t { broadleaf, conifer, bush, fruit, bale };

struct Tree {
  GroundPoint centre;
  double radius_m = 0;
  double height_m = 0;
  Plant plant = Plant::broadleaf;
  double tone = 0;
  std::uint32_t seed = 0;
};

struct Relief {
  cv::Mat_<float> heights_m;  // row 0 in the north, like an image; nodes at pixel centres
  double step_m = 8;
  double size_m = 0;
  double at(GroundPoint position) const;  // bilinear; clamped at the edges
};

struct Landscape {
  std::uint64_t seed = 0;
  double size_m = 0;
  Relief relief;
  FieldPattern fields;
  Polyline river;
  std::vector<Pond> ponds;
  std::vector<Polyline> roads;  // paved, on top of the roads of the field pattern
  std::vector<Polyline> lanes;  // gravel
  std::vector<Building> buildings;
  std::vector<Plot> plots;
  std::vector<Tree> trees;
  GroundPoint village;
};

// A cut that bounds parcels, as a line on the ground.
struct BorderLine {
  Border border = Border::furrow;
  std::vector<GroundPoint> points;
};

// A Catmull-Rom curve through the knots, with a point about every step_m.
std::vector<GroundPoint> smooth_curve(const std::vector<GroundPoint>& knots, double step_m);

Landscape generate_landscape(std::uint64_t seed, double size_m);

}  // namespace nadir
