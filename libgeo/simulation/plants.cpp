#include "simulation/plants.hpp"

#include <algorithm>
#include <cmath>

namespace nadir {
namespace {

class Gardener {
 public:
  Gardener(const Random& random, Landscape& land) : random_(random.fork("trees")), land_(land) {}

  void plant(Spot spot, double radius, double height, Plant plant) {
    land_.trees.push_back(
        {spot, radius, height, plant, random_.uniform(-1, 1), static_cast<std::uint32_t>(random_.integer(0, 1 << 30))});
  }

  // What stands in parcels: everything on jittered grids, so that no pass over parcels needs their outlines.
  void woods() {
    over_grid(5.6, [&](Spot spot, const Parcel& parcel, const FieldPattern::Hit& hit) {
      if (parcel.crop != Crop::wood && parcel.crop != Crop::conifers) return;
      const Border border = land_.fields.cuts[static_cast<std::size_t>(hit.nearest_cut)].border;
      const bool way = border == Border::road || border == Border::track;
      // Woods grow together over mere boundaries, and their rims are ragged.
      if (hit.border_m < random_.uniform(-0.4, way ? 3.5 : 1.2) || !clear(spot, 5) || random_.chance(0.05)) return;
      const bool conifer = parcel.crop == Crop::conifers ? random_.chance(0.93) : random_.chance(0.1);
      const double age = 0.8 + 0.3 * unit_hash(parcel.seed, 5) + 0.1 * parcel.tone;
      if (conifer) {
        plant(spot, age * random_.uniform(1.9, 3.0), age * random_.uniform(14, 21), Plant::conifer);
      } else {
        const double radius = age * random_.uniform(2.4, 4.6);
        plant(spot, radius, age * random_.uniform(9, 13) + radius * 1.4, Plant::broadleaf);
      }
    });
  }

  void meadows() {
    over_grid(26, [&](Spot spot, const Parcel& parcel, const FieldPattern::Hit& hit) {
      if (hit.border_m < 4 || !clear(spot, 6)) return;
      const bool grass = parcel.crop == Crop::pasture || parcel.crop == Crop::fallow;
      if (!random_.chance(grass ? 0.16 : parcel.crop == Crop::meadow ? 0.05 : 0.004)) return;
      const double radius = random_.uniform(1.6, 5.2);
      plant(spot, radius, radius * random_.uniform(1.7, 2.4), radius < 2.2 ? Plant::bush : Plant::broadleaf);
    });
  }

  void orchards() {
    for (const Parcel& parcel : land_.fields.parcels) {
      if (parcel.crop != Crop::orchard) continue;
      const Spot d(std::cos(parcel.row_angle_rad), std::sin(parcel.row_angle_rad)), n(-d.y, d.x);
      const double reach = parcel.length_m;
      for (double a = -reach; a < reach; a += 6) {
        for (double b = -reach; b < reach; b += 7.5) {
          const Spot uv = parcel.centre + d * (a + random_.uniform(-0.4, 0.4)) + n * (b + random_.uniform(-0.3, 0.3));
          const auto hit = land_.fields.find(uv);
          if (hit.border_m < 4 || &land_.fields.parcels[static_cast<std::size_t>(hit.parcel)] != &parcel) continue;
          const Spot spot = land_.fields.ground_from_uv(uv);
          if (!clear(spot, 4) || random_.chance(0.07)) continue;
          const double radius = random_.uniform(1.5, 2.3);
          plant(spot, radius, radius * 1.8, Plant::fruit);
        }
      }
    }
  }

  void bales() {
    over_grid(31, [&](Spot spot, const Parcel& parcel, const FieldPattern::Hit& hit) {
      if (parcel.crop != Crop::wheat || parcel.crop_before != Crop::wheat || unit_hash(parcel.seed, 9) > 0.3) return;
      if (hit.border_m > 7 && clear(spot, 5)) plant(spot, 0.85, 1.4, Plant::bale);
    });
  }

  void hedges(const std::vector<BorderLine>& borders) {
    for (const BorderLine& line : borders) {
      const bool hedge = line.border == Border::hedge;
      const bool avenue = line.border == Border::road && random_.chance(0.35);
      const bool shrubs = line.border == Border::track && random_.chance(0.35);
      if (!hedge && !avenue && !shrubs) continue;
      const double spacing = avenue ? 11 : 2.4, offset = avenue ? 5 : shrubs ? 4.2 : 0;
      const double side = random_.chance(0.5) ? 1 : -1;
      double next = random_.uniform(2, 8), gone = 0, gap_until = -1;
      for (std::size_t i = 0; i + 1 < line.points.size(); ++i) {
        const Spot step = line.points[i + 1] - line.points[i];
        const double length = cv::norm(step);
        if (length < 1e-6) continue;
        const Spot along = step * (1 / length), out(-along.y, along.x);
        for (; next < gone + length; next += spacing * random_.uniform(0.8, 1.2)) {
          if (next < gap_until) continue;
          if (random_.chance(avenue ? 0.05 : 0.035)) gap_until = next + random_.uniform(6, shrubs ? 60 : 25);
          const Spot spot = line.points[i] + along * (next - gone) + out * (side * offset + random_.uniform(-0.7, 0.7));
          if (!clear(spot, 4.5)) continue;
          if (avenue) {
            const double radius = random_.uniform(2.6, 4.2);
            plant(spot, radius, radius * 2.3, Plant::broadleaf);
          } else if (random_.chance(0.1)) {
            const double radius = random_.uniform(2.5, 5);
            plant(spot, radius, radius * 2, Plant::broadleaf);
          } else {
            const double radius = random_.uniform(1.1, 2.1);
            plant(spot, radius, radius * 1.8, Plant::bush);
          }
        }
        gone += length;
      }
    }
  }

  void river_banks() {
    const Noise density(static_cast<std::uint64_t>(random_.uniform() * 0x1.0p53), 130);
    const auto& points = land_.river.points;
    for (std::size_t i = 0; i + 1 < points.size(); ++i) {
      const Spot step = points[i + 1] - points[i];
      const Spot out = Spot(-step.y, step.x) * (1 / cv::norm(step));
      for (const double side : {-1.0, 1.0}) {
        for (int k = 0; k < 3; ++k) {
          const Spot spot = points[i] + step * random_.uniform() +
                            out * (side * (land_.river.half_widths_m[i] + random_.uniform(2, 15)));
          if (density.at(spot.x + side * 500, spot.y) < random_.uniform(-0.25, 0.5) || !clear(spot, 3)) continue;
          const double radius = random_.uniform(1.3, 4.6);
          plant(spot, radius, radius * 2.1, radius < 2 ? Plant::bush : Plant::broadleaf);
        }
      }
    }
  }

 private:
  template <typename Visit>
  void over_grid(double spacing, Visit&& visit) {
    const int count = static_cast<int>(land_.size_m / spacing) + 1;
    for (int r = 0; r < count; ++r) {
      for (int c = 0; c < count; ++c) {
        const Spot spot((c + random_.uniform(0.1, 0.9)) * spacing, (r + random_.uniform(0.1, 0.9)) * spacing);
        const auto hit = land_.fields.find(land_.fields.uv_from_ground(spot));
        visit(spot, land_.fields.parcels[static_cast<std::size_t>(hit.parcel)], hit);
      }
    }
  }

  bool clear(Spot spot, double gap) const {
    for (const Way& road : land_.roads) {
      if (distance_m(road, spot) < gap + 2.5) return false;
    }
    if (distance_m(land_.river, spot) < 11) return false;
    for (const Pond& pond : land_.ponds) {
      if (pond.edge_m(spot) < 1) return false;
    }
    for (const Plot& plot : land_.plots) {
      const Spot d = spot - plot.centre, axis(std::cos(plot.angle_rad), std::sin(plot.angle_rad));
      if (std::abs(d.dot(axis)) < plot.length_m / 2 + 1 &&
          std::abs(d.dot(Spot(-axis.y, axis.x))) < plot.width_m / 2 + 1) {
        return false;
      }
    }
    return true;
  }

  Random random_;
  Landscape& land_;
};

}  // namespace

void plant_trees(const Random& random, const std::vector<BorderLine>& borders, Landscape& land) {
  Gardener gardener(random, land);
  gardener.woods();
  gardener.meadows();
  gardener.orchards();
  gardener.bales();
  gardener.hedges(borders);
  gardener.river_banks();
}

}  // namespace nadir
