// Water, gardens and roads.
#include "simulation/painter_canvas.hpp"

namespace nadir {
namespace {

// Signed distance (negative inside) to a way with varying width, and the distance to its middle, for every pixel that
// lies within reach of its edge.
struct WayDistance {
  cv::Mat_<float> edge_m;
  cv::Mat_<float> middle_m;
  cv::Mat_<float> along_m;
  bool touched = false;

  WayDistance(const Way& way, const PixelGrid& grid, double reach_m) {
    double gone = 0;
    for (std::size_t i = 0; i + 1 < way.points.size(); ++i) {
      const Spot a = way.points[i], b = way.points[i + 1], ab = b - a;
      const double wa = way.half_widths_m[i], wb = way.half_widths_m[i + 1], reach = std::max(wa, wb) + reach_m;
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
          const Spot ap(grid.x(column) - a.x, grid.y(row) - a.y);
          const double t = std::clamp(ap.dot(ab) * inverse, 0.0, 1.0);
          const double dx = ap.x - t * ab.x, dy = ap.y - t * ab.y;
          const double middle = std::sqrt(dx * dx + dy * dy);
          const double edge = middle - (wa + t * (wb - wa));
          if (edge < static_cast<double>(edge_m(row, column))) {
            edge_m(row, column) = static_cast<float>(edge);
            middle_m(row, column) = static_cast<float>(middle);
            along_m(row, column) = static_cast<float>(gone + t * length);
          }
        }
      }
      gone += length;
    }
  }
};

}  // namespace

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
  const WayDistance river(land_.river, grid, 16);
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
    const double reach = std::hypot(plot.length_m, plot.width_m) / 2 + 1;
    const PixelBox box(grid, plot.centre, reach);
    if (box.empty()) continue;
    const double ca = std::cos(plot.angle_rad), sa = std::sin(plot.angle_rad);
    const Light base = cover_colour(plot.cover, season_) * (1 + 0.13 * plot.tone);
    for (int row = box.first_row; row <= box.last_row; ++row) {
      for (int column = box.first_column; column <= box.last_column; ++column) {
        const Spot d(grid.x(column) - plot.centre.x, grid.y(row) - plot.centre.y);
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
            line = std::min({line, std::abs(a), std::abs(std::hypot(a, b) - 9),
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
    const Way& way = land_.roads[i];
    const WayDistance road(way, grid, 4);
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

}  // namespace nadir
