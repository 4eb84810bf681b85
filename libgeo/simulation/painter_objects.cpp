// What stands on the ground: houses and trees.
#include "simulation/painter_canvas.hpp"

namespace nadir {

void Painter::buildings(Canvas& canvas) const {
  const PixelGrid& grid = canvas.grid;
  const Presence absent = season_ == Season::may ? Presence::day_only : Presence::before_only;
  for (const Building& b : land_.buildings) {
    if (b.presence == absent) continue;
    const PixelBox box(grid, b.centre, std::hypot(b.length_m, b.width_m) / 2 + 1);
    if (box.empty()) continue;
    const double ca = std::cos(b.angle_rad), sa = std::sin(b.angle_rad);
    const Roof roof = season_ == Season::may ? b.roof_before : b.roof;
    const Light base = roof_colour(roof) * (1 + 0.16 * b.tone);
    const bool tower = b.ridge_m - b.eaves_m > 0.9 * b.width_m;
    for (int row = box.first_row; row <= box.last_row; ++row) {
      for (int column = box.first_column; column <= box.last_column; ++column) {
        const Spot d(grid.x(column) - b.centre.x, grid.y(row) - b.centre.y);
        const double a = d.x * ca + d.y * sa, c = d.y * ca - d.x * sa;
        const double across = std::abs(c) / (b.width_m / 2), along = std::abs(a) / (b.length_m / 2);
        const bool round = roof == Roof::round;
        const double edge = round ? std::hypot(a, c) - b.width_m / 2
                                  : std::max(std::abs(a) - b.length_m / 2, std::abs(c) - b.width_m / 2);
        const double cover = cover_of(edge, grid.gsd_m);
        if (cover <= 0) continue;
        const double fall = round ? std::hypot(a, c) / (b.width_m / 2) : tower ? std::max(across, along) : across;
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
