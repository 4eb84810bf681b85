#include "simulation/painter.hpp"

#include "simulation/painter_canvas.hpp"

namespace nadir {

Painter::Painter(const Landscape& land, Season season) : land_(land), season_(season) {
  looks_.reserve(land.fields.parcels.size());
  for (const Parcel& parcel : land.fields.parcels) {
    looks_.push_back(look_of(parcel, season));
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

// Paints fields row by row: the parcel's look, its rows, the tractor's tracks, headlands, soil and margins.
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
      const Spot uv(grid.x(column) + static_cast<double>(u(row, column)),
                    grid.y(row) + static_cast<double>(v(row, column)));
      const auto hit = pattern.find(uv);
      const auto index = static_cast<std::size_t>(hit.parcel);
      const Parcel& parcel = pattern.parcels[index];
      const CropLook& look = looks_[index];
      const double patch = static_cast<double>(canvas.patches(row, column));
      const double fine = static_cast<double>(canvas.fine(row, column));
      const double ground = static_cast<double>(soil(row, column));
      const double grain = unit_hash(grain_seed, grid.first_column + column, grid.first_row + row) - 0.5;
      const double edge = hit.border_m + 0.5 * patch;

      const double ca = rows_[index].x, sa = rows_[index].y;
      const Spot local = uv - parcel.centre;
      const double along = local.x * ca + local.y * sa;
      double across = local.y * ca - local.x * sa;
      // On the headland the machine turns: it works along the border instead.
      const double headland = 13 + 6 * unit_hash(parcel.seed, 4);
      const Cut& cut = pattern.cuts[static_cast<std::size_t>(hit.nearest_cut)];
      const bool at_end = std::abs(cut.normal.x * ca + cut.normal.y * sa) > 0.6;
      const bool turning = at_end && look.rows < 0.3 && hit.border_m < headland && look.passes > 0;
      if (turning) across = hit.border_m + 200;

      Light light = look.colour;
      double blend = 0.5 * smooth_step(0.15, 0.75, ground * 0.8 + patch * 0.5 + 0.25 * parcel.tone) *
                     (look.mottle > 0.12 ? 1 : 0.5);
      if (!may && parcel.half_done < 1 && along > (parcel.half_done - 0.5) * parcel.length_m) {
        light = light_from_srgb(112, 94, 74);  // ploughed since the morning
        blend *= 0.3;
      }
      double shade = 1 + look.mottle * (0.75 * ground + 0.45 * patch) + look.grain * (0.9 * fine + 0.9 * grain);
      if (look.rows > 0) {
        // Rows finer than two pixels are not drawn as rows: they would beat against the grid.
        const double visible = std::clamp(look.row_m / grid.gsd_m - 2, 0.0, 1.0);
        const double wave = std::cos(6.283185307 * (across + 0.25 * fine) / look.row_m);
        if (look.rows > 0.3) {
          blend = std::clamp(blend + look.rows * visible * wave, 0.0, 1.0);
        } else {
          shade += look.rows * visible * wave * (0.6 + 0.4 * patch);
        }
      }
      if (look.passes > 0) {
        const double width = look.row_m * 2 + 3;
        const auto pass = static_cast<std::int64_t>(std::floor(across / width));
        shade += look.passes * (unit_hash(parcel.seed, pass, turning ? 2 : 1) - 0.5) * 1.4;
        const double seam = std::abs(across - (static_cast<double>(pass) + 0.5) * width) - 0.5 * width;
        shade -= look.passes * 0.8 * cover_of(-seam - 0.3, std::max(grid.gsd_m, 0.4));
      }
      light += (look.second - light) * std::clamp(blend, 0.0, 1.0);
      if (look.tramlines > 0) {
        const double spacing = 18 + 6 * std::floor(3 * unit_hash(parcel.seed, 6));
        const double from_middle = std::abs(std::remainder(turning ? hit.border_m - headland * 0.5 : across, spacing));
        const double wheel = std::abs(from_middle - 0.95) - 0.28;
        light += (look.second * 1.08 - light) * (look.tramlines * 0.75 * cover_of(wheel, std::max(0.5, grid.gsd_m)));
      }
      light *= std::max(0.2, shade);

      // Margins, tracks, roads.
      const double margin = cut.border == Border::furrow ? 0.3 : cut.border == Border::hedge ? 1.6 : 1.1;
      const bool wooded = parcel.crop == Crop::wood || parcel.crop == Crop::conifers;
      const Light verge = (wooded ? look.colour : grass) * (1 + 0.16 * patch + 0.10 * fine + 0.08 * grain);
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

}  // namespace nadir
