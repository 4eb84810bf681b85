#include "simulation/painter.hpp"

#include <algorithm>
#include <cmath>

#include "geodesy/hypotenuse.hpp"

namespace nadir {

// The painter's working state for one piece.
struct Painter::Canvas {
  PixelGrid grid;
  Painting painting;
  cv::Mat_<float> patches;  // noise of 8–30 m
  cv::Mat_<float> fine;     // noise of 1–3 m
  cv::Mat_<float> road;     // cover of the fields' own roads, painted above water

  void mix(int row, int column, const Light& light, double alpha) {
    cv::Vec3f& pixel = painting.colour(row, column);
    for (int i = 0; i < 3; ++i) {
      pixel[i] += static_cast<float>(alpha) * (static_cast<float>(light[i]) - pixel[i]);
    }
  }
};

namespace {

double smooth_step(double low, double high, double value) {
  const double t = std::clamp((value - low) / (high - low), 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

// Fraction of a pixel that lies inside an edge at signed distance `edge_m` (negative inside).
double cover_of(double edge_m, double gsd_m) { return std::clamp(0.5 - edge_m / gsd_m, 0.0, 1.0); }

// The pixels of the grid within `reach_m` of a point.
struct PixelBox {
  int first_column, last_column, first_row, last_row;

  PixelBox(const PixelGrid& grid, GroundPoint low, GroundPoint high)
      : first_column(std::max(0, static_cast<int>(std::floor(grid.column_of(low.x))))),
        last_column(std::min(grid.columns - 1, static_cast<int>(std::ceil(grid.column_of(high.x))))),
        first_row(std::max(0, static_cast<int>(std::floor(grid.row_of(high.y))))),
        last_row(std::min(grid.rows - 1, static_cast<int>(std::ceil(grid.row_of(low.y))))) {}
  PixelBox(const PixelGrid& grid, GroundPoint centre, double reach_m)
      : PixelBox(grid, centre - GroundPoint(reach_m, reach_m), centre + GroundPoint(reach_m, reach_m)) {}
  bool empty() const { return first_column > last_column || first_row > last_row; }
};

// Signed distance (negative inside) to a polyline of varying width, and the distance to its centre line, for every
// pixel within reach of its edge.
struct PolylineDistance {
  cv::Mat_<float> edge_m;
  cv::Mat_<float> middle_m;
  cv::Mat_<float> along_m;
  bool touched = false;

  PolylineDistance(const Polyline& line, const PixelGrid& grid, double reach_m) {
    double travelled = 0;
    for (std::size_t i = 0; i + 1 < line.points.size(); ++i) {
      const GroundPoint a = line.points[i], b = line.points[i + 1], ab = b - a;
      const double wa = line.half_widths_m[i], wb = line.half_widths_m[i + 1], reach = std::max(wa, wb) + reach_m;
      const PixelBox box(grid, {std::min(a.x, b.x) - reach, std::min(a.y, b.y) - reach},
                         {std::max(a.x, b.x) + reach, std::max(a.y, b.y) + reach});
      if (!box.empty() && !touched) {
        touched = true;
        edge_m = cv::Mat_<float>(grid.rows, grid.columns, 1e9F);
        middle_m = cv::Mat_<float>(grid.rows, grid.columns, 1e9F);
        along_m = cv::Mat_<float>(grid.rows, grid.columns, 0.F);
      }
      const double inverse = 1 / std::max(ab.dot(ab), 1e-9), length = std::sqrt(ab.dot(ab));
      for (int row = box.first_row; row <= box.last_row; ++row) {
        for (int column = box.first_column; column <= box.last_column; ++column) {
          const GroundPoint ap(grid.x(column) - a.x, grid.y(row) - a.y);
          const double t = std::clamp(ap.dot(ab) * inverse, 0.0, 1.0);
          const double dx = ap.x - t * ab.x, dy = ap.y - t * ab.y;
          const double middle = std::sqrt(dx * dx + dy * dy);
          const double edge = middle - (wa + t * (wb - wa));
          if (edge < static_cast<double>(edge_m(row, column))) {
            edge_m(row, column) = static_cast<float>(edge);
            middle_m(row, column) = static_cast<float>(middle);
            along_m(row, column) = static_cast<float>(travelled + t * length);
          }
        }
      }
      travelled += length;
    }
  }
};

}  // namespace
Painter::Painter(const Landscape& land, Season season) : land_(land), season_(season) {
  appearances_.reserve(land.fields.parcels.size());
  for (const Parcel& parcel : land.fields.parcels) {
    appearances_.push_back(appearance_of(parcel, season));
    rows_.emplace_back(std::cos(parcel.row_angle_rad), std::sin(parcel.row_angle_rad));
  }
}

Painting Painter::paint(const PixelGrid& grid) const {
  Canvas canvas;
  canvas.grid = grid;
  canvas.painting.colour.create(grid.rows, grid.columns);
  canvas.painting.height_m = cv::Mat_<float>::zeros(grid.rows, grid.columns);
  canvas.painting.gloss = cv::Mat_<float>::zeros(grid.rows, grid.columns);
  canvas.patches = cv::Mat_<float>::zeros(grid.rows, grid.columns);
  canvas.fine = cv::Mat_<float>::zeros(grid.rows, grid.columns);
  canvas.road = cv::Mat_<float>::zeros(grid.rows, grid.columns);
  const std::uint64_t patch_seed = land_.seed * 31 + (season_ == Season::may ? 5 : 6);
  Noise(hash_of(patch_seed, 1), 31).add(grid, 0.9, canvas.patches);
  Noise(hash_of(patch_seed, 2), 11).add(grid, 0.6, canvas.patches);
  Noise(hash_of(patch_seed, 3), 4.3).add(grid, 0.6, canvas.fine);
  Noise(hash_of(patch_seed, 4), 1.9).add(grid, 0.7, canvas.fine);
  fields(canvas);
  water(canvas);
  plots(canvas);
  roads(canvas);
  buildings(canvas);
  trees(canvas);
  return std::move(canvas.painting);
}

// Paints fields row by row: the parcel's appearance, its rows, the tractor's tracks, headlands, soil and margins.
void Painter::fields(Canvas& canvas) const {
  const PixelGrid& grid = canvas.grid;
  const FieldPattern& pattern = land_.fields;
  cv::Mat_<float> u(grid.rows, grid.columns, 0.F), v(grid.rows, grid.columns, 0.F), soil(grid.rows, grid.columns, 0.F);
  pattern.warp_x.add(grid, pattern.warp_m, u);
  pattern.warp_y.add(grid, pattern.warp_m, v);
  const std::uint64_t soil_seed = land_.seed * 17;  // soil stays from season to season
  Noise(hash_of(soil_seed, 1), 260).add(grid, 0.8, soil);
  Noise(hash_of(soil_seed, 2), 95).add(grid, 0.7, soil);
  Noise(hash_of(soil_seed, 3), 42).add(grid, 0.5, soil);
  const bool may = season_ == Season::may;
  const Light grass = may ? light_from_srgb(112, 134, 74) : light_from_srgb(136, 136, 88);
  const Light gravel = light_from_srgb(182, 168, 142);
  const std::uint64_t grain_seed = hash_of(land_.seed, may ? 101 : 102);

  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      const GroundPoint uv(grid.x(column) + static_cast<double>(u(row, column)),
                           grid.y(row) + static_cast<double>(v(row, column)));
      const auto hit = pattern.find(uv);
      const auto index = static_cast<std::size_t>(hit.parcel);
      const Parcel& parcel = pattern.parcels[index];
      const CropAppearance& appearance = appearances_[index];
      const double patch = static_cast<double>(canvas.patches(row, column));
      const double fine = static_cast<double>(canvas.fine(row, column));
      const double ground = static_cast<double>(soil(row, column));
      const double grain = unit_hash(grain_seed, grid.first_column + column, grid.first_row + row) - 0.5;
      const double edge = hit.border_m + 0.5 * patch;

      const double ca = rows_[index].x, sa = rows_[index].y;
      const GroundPoint local = uv - parcel.centre;
      const double along = local.x * ca + local.y * sa;
      double across = local.y * ca - local.x * sa;
      // On the headland machines turn and work along the border instead.
      const double headland = 13 + 6 * unit_hash(parcel.seed, 4);
      const Cut& cut = pattern.cuts[static_cast<std::size_t>(hit.nearest_cut)];
      const bool at_end = std::abs(cut.normal.x * ca + cut.normal.y * sa) > 0.6;
      const bool turning = at_end && appearance.rows < 0.3 && hit.border_m < headland && appearance.passes > 0;
      if (turning) across = hit.border_m + 200;

      Light light = appearance.colour;
      double blend = 0.5 * smooth_step(0.15, 0.75, ground * 0.8 + patch * 0.5 + 0.25 * parcel.tone) *
                     (appearance.mottle > 0.12 ? 1 : 0.5);
      if (!may && parcel.half_done < 1 && along > (parcel.half_done - 0.5) * parcel.length_m) {
        light = light_from_srgb(112, 94, 74);  // ploughed on the day
        blend *= 0.3;
      }
      double shade =
          1 + appearance.mottle * (0.75 * ground + 0.45 * patch) + appearance.grain * (0.9 * fine + 0.9 * grain);
      if (appearance.rows > 0) {
        // Rows finer than two pixels are not drawn as rows: they would cause moiré.
        const double visible = std::clamp(appearance.row_m / grid.gsd_m - 2, 0.0, 1.0);
        const double wave = std::cos(6.283185307 * (across + 0.25 * fine) / appearance.row_m);
        if (appearance.rows > 0.3) {
          blend = std::clamp(blend + appearance.rows * visible * wave, 0.0, 1.0);
        } else {
          shade += appearance.rows * visible * wave * (0.6 + 0.4 * patch);
        }
      }
      if (appearance.passes > 0) {
        const double width = appearance.row_m * 2 + 3;
        const auto pass = static_cast<std::int64_t>(std::floor(across / width));
        shade += appearance.passes * (unit_hash(parcel.seed, pass, turning ? 2 : 1) - 0.5) * 1.4;
        const double seam = std::abs(across - (static_cast<double>(pass) + 0.5) * width) - 0.5 * width;
        shade -= appearance.passes * 0.8 * cover_of(-seam - 0.3, std::max(grid.gsd_m, 0.4));
      }
      light += (appearance.second - light) * std::clamp(blend, 0.0, 1.0);
      if (appearance.tramlines > 0) {
        const double spacing = 18 + 6 * std::floor(3 * unit_hash(parcel.seed, 6));
        const double from_middle = std::abs(std::remainder(turning ? hit.border_m - headland * 0.5 : across, spacing));
        const double wheel = std::abs(from_middle - 0.95) - 0.28;
        light += (appearance.second * 1.08 - light) *
                 (appearance.tramlines * 0.75 * cover_of(wheel, std::max(0.5, grid.gsd_m)));
      }
      light *= std::max(0.2, shade);

      // Margins, tracks, roads.
      const double margin = cut.border == Border::furrow ? 0.3 : cut.border == Border::hedge ? 1.6 : 1.1;
      const bool wooded = parcel.crop == Crop::wood || parcel.crop == Crop::conifers;
      const Light verge = (wooded ? appearance.colour : grass) * (1 + 0.16 * patch + 0.10 * fine + 0.08 * grain);
      light += (verge - light) *
               (cover_of(edge - margin, std::max(grid.gsd_m, 0.8)) * (cut.border == Border::furrow ? 0.65 : 0.95));
      if (hit.track_m < 3) {
        const double half = cut.half_width_m, middle = std::abs(hit.track_m + half);
        const double ruts = cover_of(std::abs(middle - 0.8) - 0.42 + 0.15 * fine, std::max(grid.gsd_m, 0.6));
        const double worn = cover_of(hit.track_m - 0.1 + 0.3 * fine, std::max(grid.gsd_m, 0.7));
        light += (gravel * (0.9 + 0.1 * fine) - light) * std::max(0.45 * worn * (1 + 0.5 * patch), 0.85 * ruts);
      }
      canvas.painting.colour(row, column) = light;
      if (hit.road_m < 2) {
        const double verge_share = cover_of(hit.road_m - 1.1 + 0.3 * fine, 1.2);
        canvas.mix(row, column, gravel * 0.8, 0.4 * verge_share);
        canvas.road(row, column) = static_cast<float>(cover_of(hit.road_m, grid.gsd_m));
      }
    }
  }
}

// Water, gardens and roads.

void Painter::water(Canvas& canvas) const {
  const PixelGrid& grid = canvas.grid;
  const bool may = season_ == Season::may;
  const Light deep = may ? light_from_srgb(76, 88, 78) : light_from_srgb(58, 74, 72);
  const Light shallow = may ? light_from_srgb(112, 112, 88) : light_from_srgb(92, 100, 80);
  const Light reeds = may ? light_from_srgb(104, 118, 66) : light_from_srgb(120, 122, 74);
  const Light sand = light_from_srgb(176, 164, 138);
  const auto stroke = [&](int row, int column, double edge) {
    const double fine = static_cast<double>(canvas.fine(row, column));
    const double patch = static_cast<double>(canvas.patches(row, column));
    const double wobbly = edge + 1.6 * patch + 0.6 * fine;
    const double bank = 1 - smooth_step(2.5, 11, wobbly);
    if (bank > 0) canvas.mix(row, column, reeds * (1 + 0.22 * patch + 0.14 * fine), 0.85 * bank);
    if (wobbly < 2.2 && patch > 0.1)
      canvas.mix(row, column, sand, smooth_step(0.1, 0.5, patch) * cover_of(wobbly - 1.4, 1.2) * 0.8);
    const double wet = cover_of(wobbly, std::max(grid.gsd_m, 0.8));
    if (wet <= 0) return;
    const double depth = smooth_step(0, -6, wobbly);
    canvas.mix(row, column, (shallow + (deep - shallow) * depth) * (1 + 0.05 * patch + 0.03 * fine), wet);
    canvas.painting.gloss(row, column) = std::max(canvas.painting.gloss(row, column), static_cast<float>(wet));
  };
  const PolylineDistance river(land_.river, grid, 16);
  if (river.touched) {
    for (int row = 0; row < grid.rows; ++row) {
      for (int column = 0; column < grid.columns; ++column) {
        if (river.edge_m(row, column) < 15) stroke(row, column, static_cast<double>(river.edge_m(row, column)));
      }
    }
  }
  for (const Pond& pond : land_.ponds) {
    const PixelBox box(grid, pond.centre, pond.radius_m * 1.5 + 16);
    for (int row = box.first_row; row <= box.last_row; ++row) {
      for (int column = box.first_column; column <= box.last_column; ++column) {
        const double edge = pond.edge_m({grid.x(column), grid.y(row)});
        if (edge < 15) stroke(row, column, edge);
      }
    }
  }
}

void Painter::plots(Canvas& canvas) const {
  const PixelGrid& grid = canvas.grid;
  const Light white = light_from_srgb(226, 228, 222);
  for (const Plot& plot : land_.plots) {
    const double reach = hypotenuse(plot.length_m, plot.width_m) / 2 + 1;
    const PixelBox box(grid, plot.centre, reach);
    if (box.empty()) continue;
    const double ca = std::cos(plot.angle_rad), sa = std::sin(plot.angle_rad);
    const Light base = cover_colour(plot.cover, season_) * (1 + 0.13 * plot.tone);
    for (int row = box.first_row; row <= box.last_row; ++row) {
      for (int column = box.first_column; column <= box.last_column; ++column) {
        const GroundPoint d(grid.x(column) - plot.centre.x, grid.y(row) - plot.centre.y);
        const double a = d.x * ca + d.y * sa, b = d.y * ca - d.x * sa;
        const double fine = static_cast<double>(canvas.fine(row, column));
        const double patch = static_cast<double>(canvas.patches(row, column));
        const double ragged = plot.cover == Cover::wild || plot.cover == Cover::gravel ? 1.2 * patch + 0.8 * fine : 0;
        const double edge = std::max(std::abs(a) - plot.length_m / 2, std::abs(b) - plot.width_m / 2) + ragged;
        const double cover = cover_of(edge, grid.gsd_m);
        if (cover <= 0) continue;
        Light light = base * (1 + 0.08 * patch + (plot.cover == Cover::wild ? 0.16 : 0.07) * fine);
        if (plot.cover == Cover::beds) light *= 1 + 0.25 * std::cos(6.283 * b / 1.6);
        if (plot.cover == Cover::pitch) {
          light *= 1 + 0.06 * (std::fmod(std::abs(a + 200), 10) < 5 ? 1 : -1);
          const double pa = std::abs(a) - 45, pb = std::abs(b) - 29;
          double line = std::abs(std::max(pa, pb));
          if (std::max(pa, pb) < 0) {
            line = std::min({line, std::abs(a), std::abs(hypotenuse(a, b) - 9),
                             std::abs(std::max(29.0 - std::abs(a), std::abs(b) - 20))});
          }
          light += (white - light) * (0.6 * cover_of(line - 0.15, std::max(grid.gsd_m, 0.3)));
        }
        canvas.mix(row, column, light, cover);
      }
    }
  }
}

void Painter::roads(Canvas& canvas) const {
  const PixelGrid& grid = canvas.grid;
  const Light asphalt = light_from_srgb(128, 128, 130), verge = light_from_srgb(164, 158, 128);
  const Light paint = light_from_srgb(222, 222, 216), concrete = light_from_srgb(176, 174, 168);
  for (int row = 0; row < grid.rows; ++row) {  // the fields' own roads, on bridges where there is water
    for (int column = 0; column < grid.columns; ++column) {
      const double cover = static_cast<double>(canvas.road(row, column));
      if (cover <= 0) continue;
      const double tone = 1 + 0.05 * static_cast<double>(canvas.fine(row, column)) +
                          0.10 * static_cast<double>(canvas.patches(row, column));
      const bool bridge = canvas.painting.gloss(row, column) > 0;
      canvas.mix(row, column, (bridge ? concrete : asphalt * 1.1) * tone, cover);
      canvas.painting.gloss(row, column) *= static_cast<float>(1 - cover);
    }
  }
  for (std::size_t i = land_.roads.size(); i-- > 0;) {  // the main road last: it runs over the others
    const PolylineDistance road(land_.roads[i], grid, 4);
    if (!road.touched) continue;
    for (int row = 0; row < grid.rows; ++row) {
      for (int column = 0; column < grid.columns; ++column) {
        const double edge = static_cast<double>(road.edge_m(row, column));
        if (edge > 3) continue;
        const double middle = static_cast<double>(road.middle_m(row, column));
        const double along = static_cast<double>(road.along_m(row, column));
        const double fine = static_cast<double>(canvas.fine(row, column));
        const double patch = static_cast<double>(canvas.patches(row, column));
        const bool bridge = canvas.painting.gloss(row, column) > 0;
        canvas.mix(row, column, bridge ? concrete : verge,
                   (bridge ? 1.0 : 0.6) * cover_of(edge - 0.9 + (bridge ? 0 : 0.4 * fine), 0.8));
        Light light = asphalt * (1 + 0.08 * patch + 0.04 * fine);
        light *= 1 - 0.10 * std::exp(-std::pow((middle - 1.5) / 0.5, 2));  // where the wheels run
        if (i == 0) {
          const bool dash = std::fmod(along, 9) < 4.5;
          light += (paint - light) * ((dash ? 0.7 : 0.0) * cover_of(middle - 0.1, std::max(grid.gsd_m, 0.2)));
          light += (paint - light) * (0.45 * cover_of(std::abs(edge + 0.35) - 0.08, std::max(grid.gsd_m, 0.16)));
        }
        canvas.mix(row, column, light, cover_of(edge, grid.gsd_m));
        if (edge < 0) canvas.painting.gloss(row, column) = 0;
      }
    }
  }
}

// What stands on the ground: houses and trees.

void Painter::buildings(Canvas& canvas) const {
  const PixelGrid& grid = canvas.grid;
  const Presence absent = season_ == Season::may ? Presence::day_only : Presence::before_only;
  for (const Building& b : land_.buildings) {
    if (b.presence == absent) continue;
    const PixelBox box(grid, b.centre, hypotenuse(b.length_m, b.width_m) / 2 + 1);
    if (box.empty()) continue;
    const double ca = std::cos(b.angle_rad), sa = std::sin(b.angle_rad);
    const Roof roof = season_ == Season::may ? b.roof_before : b.roof;
    const Light base = roof_colour(roof) * (1 + 0.16 * b.tone);
    const bool tower = b.ridge_m - b.eaves_m > 0.9 * b.width_m;
    for (int row = box.first_row; row <= box.last_row; ++row) {
      for (int column = box.first_column; column <= box.last_column; ++column) {
        const GroundPoint d(grid.x(column) - b.centre.x, grid.y(row) - b.centre.y);
        const double a = d.x * ca + d.y * sa, c = d.y * ca - d.x * sa;
        const double across = std::abs(c) / (b.width_m / 2), along = std::abs(a) / (b.length_m / 2);
        const bool round = roof == Roof::round;
        const double edge = round ? hypotenuse(a, c) - b.width_m / 2
                                  : std::max(std::abs(a) - b.length_m / 2, std::abs(c) - b.width_m / 2);
        const double cover = cover_of(edge, grid.gsd_m);
        if (cover <= 0) continue;
        const double fall = round ? hypotenuse(a, c) / (b.width_m / 2) : tower ? std::max(across, along) : across;
        const double height = b.eaves_m + (b.ridge_m - b.eaves_m) * std::max(0.0, 1 - fall);
        const double fine = static_cast<double>(canvas.fine(row, column));
        double shade = 1 + 0.05 * fine + 0.08 * static_cast<double>(canvas.patches(row, column));
        if (roof == Roof::metal) shade *= 1 + 0.05 * std::cos(6.283 * a / 2.4);
        canvas.mix(row, column, base * shade, cover);
        float& h = canvas.painting.height_m(row, column);
        if (cover > 0.5) h = std::max(h, static_cast<float>(height));
      }
    }
  }
}

void Painter::trees(Canvas& canvas) const {
  const PixelGrid& grid = canvas.grid;
  const double left = grid.x(0), right = grid.x(grid.columns - 1), top = grid.y(0), bottom = grid.y(grid.rows - 1);
  for (const Tree& tree : land_.trees) {
    const double reach = tree.radius_m * 1.3;
    if (tree.centre.x + reach < left || tree.centre.x - reach > right) continue;
    if (tree.centre.y + reach < bottom || tree.centre.y - reach > top) continue;
    if (tree.plant == Plant::bale && season_ == Season::may) continue;
    const PixelBox box(grid, tree.centre, reach);
    if (box.empty()) continue;
    const Light base = tree_colour(tree, season_);
    const bool conifer = tree.plant == Plant::conifer, bale = tree.plant == Plant::bale;
    const double trunk = bale ? 0 : std::max(0.0, tree.height_m - (conifer ? 4.5 : 1.5) * tree.radius_m);
    const double crown = tree.height_m - trunk;
    const double p1 = 6.283 * unit_hash(tree.seed, 21), p2 = 6.283 * unit_hash(tree.seed, 22);
    for (int row = box.first_row; row <= box.last_row; ++row) {
      for (int column = box.first_column; column <= box.last_column; ++column) {
        const double dx = grid.x(column) - tree.centre.x, dy = grid.y(row) - tree.centre.y;
        const double fine = static_cast<double>(canvas.fine(row, column));
        double radius = tree.radius_m;
        if (!bale) {
          const double angle = std::atan2(dy, dx);
          radius *= 1 + 0.11 * std::cos(3 * angle + p1) + 0.09 * std::cos(5 * angle + p2) + 0.12 * fine;
        }
        const double distance = std::sqrt(dx * dx + dy * dy);
        const double cover = cover_of(distance - radius, std::max(grid.gsd_m, 0.4));
        if (cover <= 0.05) continue;
        const double q = std::min(1.0, distance / radius);
        const double shape = bale ? 1 : conifer ? 1 - q : std::sqrt(1 - q * q);
        const double height = trunk + crown * shape + (bale ? 0 : 0.9 * fine);
        float& h = canvas.painting.height_m(row, column);
        if (height < static_cast<double>(h)) continue;
        const double depth = bale ? 1 : 0.72 + 0.28 * shape;
        canvas.mix(row, column, base * (depth * (1 + 0.16 * fine)), cover);
        if (cover > 0.5) h = static_cast<float>(height);
      }
    }
  }
}

}  // namespace nadir
