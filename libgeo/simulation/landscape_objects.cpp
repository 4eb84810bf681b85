#include "simulation/landscape_objects.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nadir {
namespace {

GroundPoint direction(double angle) { return {std::cos(angle), std::sin(angle)}; }
GroundPoint left_of(GroundPoint d) { return {-d.y, d.x}; }

// A draw for each statement, wherever an operator or a function would take several: their order is the compiler's
// choice, and differs between processors.
class VillageBuilder {
 public:
  VillageBuilder(const Random& random, Landscape& land) : random_(random), land_(land) {}

  void street_houses(const Polyline& street, double from_m, double to_m, double road_half_m) {
    for (const double side : {-1.0, 1.0}) {
      double travelled = 0, next = from_m + random_.uniform(4, 14);
      for (std::size_t i = 0; i + 1 < street.points.size(); ++i) {
        const GroundPoint step = street.points[i + 1] - street.points[i];
        const double length = cv::norm(step);
        while (travelled + length > next && next < to_m) {
          const GroundPoint along = step * (1 / length), out = left_of(along) * side;
          const double width = random_.uniform(17, 27);
          plot(street.points[i] + along * (next - travelled) + out * (road_half_m + 1.5), along, out, width);
          next += width + (random_.chance(0.12) ? 14 : 1);
        }
        travelled += length;
      }
    }
  }

  void add(GroundPoint centre, double angle, double length, double width, double eaves, double pitch, Roof roof,
           Presence presence = Presence::both) {
    Building b;
    b.centre = centre, b.angle_rad = angle, b.length_m = length, b.width_m = width, b.eaves_m = eaves;
    b.ridge_m = eaves + pitch * width / 2;
    b.roof = b.roof_before = roof;
    b.tone = random_.uniform(-1, 1);
    b.presence = presence;
    land_.buildings.push_back(b);
  }

  Roof house_roof() {
    const double pick = random_.uniform();
    return pick < 0.5 ? Roof::tiles : pick < 0.75 ? Roof::brown : pick < 0.93 ? Roof::slate : Roof::flat;
  }

  bool clear_of_roads(GroundPoint position, double gap) const {
    for (const Polyline& road : land_.roads) {
      if (distance_m(road, position) < gap) return false;
    }
    const auto hit = land_.fields.find(land_.fields.uv_from_ground(position));
    if (hit.road_m < std::min(gap, 6.0) - 1 || hit.track_m < 1.5) return false;
    if (distance_m(land_.river, position) < 34) return false;
    for (const Pond& pond : land_.ponds) {
      if (pond.edge_m(position) < 12) return false;
    }
    return true;
  }

 private:
  // front: middle of the side at the street; out: away from it.
  void plot(GroundPoint front, GroundPoint along, GroundPoint out, double width) {
    const double depth = random_.uniform(30, 46);
    const GroundPoint centre = front + out * (depth / 2);
    for (const double a : {-0.45, 0.0, 0.45}) {
      for (const double o : {0.12, 0.5, 0.9}) {
        const GroundPoint position = front + along * (a * width) + out * (o * depth);
        if (!clear_of_roads(position, 4.2)) return;
        for (const Plot& other : land_.plots) {
          const GroundPoint d = position - other.centre;
          const GroundPoint axis = direction(other.angle_rad);
          if (std::abs(d.dot(axis)) < other.length_m / 2 && std::abs(d.dot(left_of(axis))) < other.width_m / 2) return;
        }
      }
    }
    const double angle = std::atan2(along.y, along.x);
    land_.plots.push_back(
        {centre, angle, width, depth, random_.chance(0.8) ? Cover::lawn : Cover::wild, random_.uniform(-1, 1)});
    if (random_.chance(0.06)) return;  // not built on

    const double setback = random_.uniform(4, 9), house_depth = random_.uniform(8.5, 11);
    const double house_length = std::min(width - 5, random_.uniform(10, 16));
    const GroundPoint house = front + out * (setback + house_depth / 2) + along * random_.uniform(-1.5, 1.5);
    const double turned = angle + random_.uniform(-0.05, 0.05) + (random_.chance(0.3) ? std::numbers::pi / 2 : 0);
    const bool across = std::abs(std::sin(turned - angle)) > 0.5;
    Presence presence = Presence::both;
    if (random_.chance(0.05)) presence = random_.chance(0.7) ? Presence::day_only : Presence::before_only;
    const Roof roof = house_roof();
    const double pitch = roof == Roof::flat ? 0 : random_.uniform(0.7, 1.0), eaves = random_.uniform(3.2, 6);
    add(house, turned, across ? house_depth + 2 : house_length, across ? house_length - 2 : house_depth, eaves, pitch,
        roof, presence);
    if (random_.chance(0.08)) land_.buildings.back().roof_before = house_roof();  // a new roof since
    if (random_.chance(0.4) && roof != Roof::flat) {                              // a wing at right angles
      Building wing = land_.buildings.back();
      wing.angle_rad += std::numbers::pi / 2;
      const double aside = random_.uniform(-2.5, 2.5);
      wing.centre += out * random_.uniform(3.5, 6) + along * aside;
      wing.length_m = random_.uniform(8, 11), wing.width_m = random_.uniform(5.5, 7);
      wing.ridge_m = wing.eaves_m + 0.8 * wing.width_m / 2;
      land_.buildings.push_back(wing);
    }
    if (random_.chance(0.6)) {  // garage or shed
      const Roof shed_roof = random_.chance(0.5) ? Roof::flat : Roof::brown;
      const double pitch_of_shed = random_.chance(0.5) ? 0.4 : 0, shed_width = random_.uniform(3.5, 5);
      const double shed_length = random_.uniform(5, 7), shed_side = random_.chance(0.5) ? 1 : -1;
      add(front + out * (setback + house_depth + random_.uniform(5, 9)) + along * shed_side * (width / 2 - 4), angle,
          shed_length, shed_width, 2.5, pitch_of_shed, shed_roof);
    }
    const double drive_side = random_.chance(0.5) ? 1 : -1;
    land_.plots.push_back({front + along * (drive_side * (width / 2 - 2.2)) + out * 7.0, angle + std::numbers::pi / 2,
                           16, 3.2, random_.chance(0.5) ? Cover::paving : Cover::gravel, random_.uniform(-1, 1)});
    if (random_.chance(0.55)) {
      land_.plots.push_back({front + out * (depth - 7) + along * random_.uniform(-3, 3), angle, random_.uniform(6, 11),
                             random_.uniform(5, 9), Cover::beds, random_.uniform(-1, 1)});
    }
    const int trees = random_.integer(0, 4);
    for (int i = 0; i < trees; ++i) {
      const double aside = random_.uniform(-0.45, 0.45);
      const GroundPoint position = front + out * random_.uniform(0.55, 0.95) * depth + along * aside * width;
      const double radius = random_.uniform(1.5, 3.8);
      land_.trees.push_back({position, radius, radius * random_.uniform(1.6, 2.4),
                             random_.chance(0.2) ? Plant::conifer : Plant::broadleaf, random_.uniform(-1, 1),
                             static_cast<std::uint32_t>(random_.integer(0, 1 << 30))});
    }
    if (random_.chance(0.5)) {  // a hedge at the back
      for (double a = -width / 2; a < width / 2; a += 1.3) {
        land_.trees.push_back({front + out * depth + along * a, random_.uniform(0.8, 1.1), random_.uniform(1.4, 2),
                               Plant::bush, random_.uniform(-1, 1),
                               static_cast<std::uint32_t>(random_.integer(0, 1 << 30))});
      }
    }
  }

  Random random_;
  Landscape& land_;
};

double arc_length_to(const Polyline& line, GroundPoint position) {
  double travelled = 0, best = 1e18, at = 0;
  for (std::size_t i = 0; i + 1 < line.points.size(); ++i) {
    const double d = cv::norm(line.points[i] - position);
    if (d < best) best = d, at = travelled;
    travelled += cv::norm(line.points[i + 1] - line.points[i]);
  }
  return at;
}

}  // namespace

void build_village(const Random& random, Landscape& land) {
  Random own = random.fork("village");
  const Polyline main = land.roads[0];
  const double middle = arc_length_to(main, land.village);
  double travelled = 0;
  std::vector<std::pair<GroundPoint, GroundPoint>> forks;  // where side streets leave, and the road's direction there
  std::vector<double> at = {middle - 130, middle - 40, middle + 55, middle + 150};
  for (std::size_t i = 0; i + 1 < main.points.size(); ++i) {
    const GroundPoint step = main.points[i + 1] - main.points[i];
    const double length = cv::norm(step);
    for (const double a : at) {
      if (a >= travelled && a < travelled + length) forks.emplace_back(main.points[i], step * (1 / length));
    }
    travelled += length;
  }
  double side = own.chance(0.5) ? 1 : -1;
  std::vector<Polyline> streets;
  for (const auto& [from, along] : forks) {
    const GroundPoint out = left_of(along) * side;
    side = -side;
    const double length = own.uniform(150, 260), bend = own.uniform(-0.5, 0.5);
    std::vector<GroundPoint> knots = {from};
    double angle = std::atan2(out.y, out.x);
    GroundPoint here = from;
    for (int i = 0; i < 4; ++i) {
      here += direction(angle) * (length / 4);
      knots.push_back(here);
      angle += bend * own.uniform(0.3, 0.9);
    }
    Polyline street{smooth_curve(knots, 6), {}};
    for (std::size_t i = 6; i < street.points.size(); ++i) {  // ends where it meets a road
      if (land.fields.find(land.fields.uv_from_ground(street.points[i])).road_m < 0) {
        street.points.resize(i + 1);
        break;
      }
    }
    street.half_widths_m.assign(street.points.size(), own.uniform(2.2, 2.7));
    streets.push_back(street);
  }
  land.roads.insert(land.roads.end(), streets.begin(), streets.end());
  VillageBuilder builder(own, land);
  // A church in the middle, before the houses.
  const double north_m = own.uniform(-10, 10);
  const GroundPoint church = land.village + GroundPoint(own.uniform(24, 32), north_m);
  if (builder.clear_of_roads(church, 16)) {
    const double angle = own.uniform(-0.3, 0.3);
    builder.add(church, angle, 24, 12, 9, 1.1, Roof::slate);
    builder.add(church - direction(angle) * 15.0, angle, 7, 7, 22, 2.2, Roof::slate);
    land.plots.push_back({church, angle, 48, 30, Cover::lawn, 0.2});
  }
  builder.street_houses(main, middle - 280, middle + 290, 3.4);
  for (const Polyline& street : streets) builder.street_houses(street, 14, 400, 2.6);
  // A sports ground at the edge.
  const double angle = own.uniform(0, std::numbers::pi);
  for (int i = 0; i < 24; ++i) {
    const double from_village_m = own.uniform(180, 330);
    const GroundPoint position = land.village + direction(own.uniform(0, 6.28)) * from_village_m;
    bool free = builder.clear_of_roads(position, 62);
    for (const Plot& plot : land.plots) free = free && cv::norm(plot.centre - position) > 85;
    if (!free) continue;
    land.plots.push_back({position, angle, 112, 74, Cover::lawn, -0.2});
    land.plots.push_back({position, angle, 100, 62, Cover::pitch, 0});
    break;
  }
}

void build_farms(const Random& random, Landscape& land) {
  Random own = random.fork("farms");
  VillageBuilder builder(own.fork("houses"), land);
  const int farms = std::max(2, static_cast<int>(land.size_m * land.size_m / 0.55e6));
  for (int i = 0, tries = 0; i < farms && tries < 40 * farms; ++tries) {
    const double y = own.uniform(0.04, 0.96) * land.size_m;
    const GroundPoint position(own.uniform(0.04, 0.96) * land.size_m, y);
    const GroundPoint uv = land.fields.uv_from_ground(position);
    const auto hit = land.fields.find(uv);
    const Parcel& parcel = land.fields.parcels[static_cast<std::size_t>(hit.parcel)];
    const double access_m = std::min(hit.road_m, hit.track_m);
    if (access_m < 34 || access_m > 55 || hit.border_m < 20 || parcel.crop == Crop::wood ||
        parcel.crop == Crop::conifers)
      continue;
    if (!builder.clear_of_roads(position, 45) || cv::norm(position - land.village) < 380) continue;
    ++i;
    const Cut& cut = land.fields.cuts[static_cast<std::size_t>(hit.nearest_cut)];
    const double angle = std::atan2(cut.normal.y, cut.normal.x) + own.uniform(-0.06, 0.06);
    const GroundPoint along = direction(angle), across = left_of(along);
    land.plots.push_back({position, angle, 78, 64, Cover::wild, own.uniform(-1, 1)});
    land.plots.push_back({position, angle, 62, 40, Cover::gravel, own.uniform(-1, 1)});
    land.plots.push_back({position + along * 4.0, angle, 24, 22, Cover::paving, own.uniform(-1, 1)});
    const Roof barn = own.chance(0.5) ? Roof::metal : own.chance(0.5) ? Roof::tiles : Roof::brown;
    const double barn_width = own.uniform(13, 17), barn_length = own.uniform(26, 40);
    builder.add(position + across * 19.0 + along * own.uniform(-6, 6), angle, barn_length, barn_width, 5.5, 0.5, barn);
    const Presence stable_presence = own.chance(0.2) ? Presence::day_only : Presence::both;
    const Roof stable = own.chance(0.5) ? Roof::metal : Roof::brown;
    const double stable_width = own.uniform(11, 14), stable_length = own.uniform(18, 28);
    builder.add(position - along * 24.0 - across * 4.0, angle + std::numbers::pi / 2, stable_length, stable_width, 5,
                0.6, stable, stable_presence);
    builder.add(position - across * 17.0 + along * 12.0, angle, 15, 10.5, 5, 0.9, Roof::tiles);
    if (own.chance(0.6)) builder.add(position + along * 27.0 + across * 8.0, angle, 8, 8, 9, 0.25, Roof::round);
    if (own.chance(0.4)) builder.add(position + along * 27.0 - across * 4.0, angle, 7, 7, 8, 0.25, Roof::round);
    for (int k = own.integer(5, 12); k > 0; --k) {
      const double from_farm_m = own.uniform(36, 48);
      const GroundPoint tree = position + direction(own.uniform(0, 6.28)) * from_farm_m;
      const double radius = own.uniform(2.2, 5);
      land.trees.push_back({tree, radius, radius * 2.2, Plant::broadleaf, own.uniform(-1, 1),
                            static_cast<std::uint32_t>(own.integer(0, 1 << 30))});
    }
  }
}

namespace {

class TreePlanter {
 public:
  TreePlanter(const Random& random, Landscape& land) : random_(random.fork("trees")), land_(land) {}

  void plant(GroundPoint position, double radius, double height, Plant plant) {
    land_.trees.push_back({position, radius, height, plant, random_.uniform(-1, 1),
                           static_cast<std::uint32_t>(random_.integer(0, 1 << 30))});
  }

  // Trees in parcels are placed on jittered grids, so that no pass over parcels needs their outlines.
  void woods() {
    over_grid(5.6, [&](GroundPoint position, const Parcel& parcel, const FieldPattern::Hit& hit) {
      if (parcel.crop != Crop::wood && parcel.crop != Crop::conifers) return;
      const Border border = land_.fields.cuts[static_cast<std::size_t>(hit.nearest_cut)].border;
      const bool paved = border == Border::road || border == Border::track;
      // Woods close over minor boundaries, and their edges are ragged.
      if (hit.border_m < random_.uniform(-0.4, paved ? 3.5 : 1.2) || !clear(position, 5) || random_.chance(0.05))
        return;
      const bool conifer = parcel.crop == Crop::conifers ? random_.chance(0.93) : random_.chance(0.1);
      const double age = 0.8 + 0.3 * unit_hash(parcel.seed, 5) + 0.1 * parcel.tone;
      if (conifer) {
        const double height = age * random_.uniform(14, 21);
        plant(position, age * random_.uniform(1.9, 3.0), height, Plant::conifer);
      } else {
        const double radius = age * random_.uniform(2.4, 4.6);
        plant(position, radius, age * random_.uniform(9, 13) + radius * 1.4, Plant::broadleaf);
      }
    });
  }

  void meadows() {
    over_grid(26, [&](GroundPoint position, const Parcel& parcel, const FieldPattern::Hit& hit) {
      if (hit.border_m < 4 || !clear(position, 6)) return;
      const bool grass = parcel.crop == Crop::pasture || parcel.crop == Crop::fallow;
      if (!random_.chance(grass ? 0.16 : parcel.crop == Crop::meadow ? 0.05 : 0.004)) return;
      const double radius = random_.uniform(1.6, 5.2);
      plant(position, radius, radius * random_.uniform(1.7, 2.4), radius < 2.2 ? Plant::bush : Plant::broadleaf);
    });
  }

  void orchards() {
    for (const Parcel& parcel : land_.fields.parcels) {
      if (parcel.crop != Crop::orchard) continue;
      const GroundPoint d(std::cos(parcel.row_angle_rad), std::sin(parcel.row_angle_rad)), n(-d.y, d.x);
      const double reach = parcel.length_m;
      for (double a = -reach; a < reach; a += 6) {
        for (double b = -reach; b < reach; b += 7.5) {
          const double across = b + random_.uniform(-0.3, 0.3);
          const GroundPoint uv = parcel.centre + d * (a + random_.uniform(-0.4, 0.4)) + n * across;
          const auto hit = land_.fields.find(uv);
          if (hit.border_m < 4 || &land_.fields.parcels[static_cast<std::size_t>(hit.parcel)] != &parcel) continue;
          const GroundPoint position = land_.fields.ground_from_uv(uv);
          if (!clear(position, 4) || random_.chance(0.07)) continue;
          const double radius = random_.uniform(1.5, 2.3);
          plant(position, radius, radius * 1.8, Plant::fruit);
        }
      }
    }
  }

  void bales() {
    over_grid(31, [&](GroundPoint position, const Parcel& parcel, const FieldPattern::Hit& hit) {
      if (parcel.crop != Crop::wheat || parcel.crop_before != Crop::wheat || unit_hash(parcel.seed, 9) > 0.3) return;
      if (hit.border_m > 7 && clear(position, 5)) plant(position, 0.85, 1.4, Plant::bale);
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
      double next = random_.uniform(2, 8), travelled = 0, gap_until = -1;
      for (std::size_t i = 0; i + 1 < line.points.size(); ++i) {
        const GroundPoint step = line.points[i + 1] - line.points[i];
        const double length = cv::norm(step);
        if (length < 1e-6) continue;
        const GroundPoint along = step * (1 / length), out(-along.y, along.x);
        for (; next < travelled + length; next += spacing * random_.uniform(0.8, 1.2)) {
          if (next < gap_until) continue;
          if (random_.chance(avenue ? 0.05 : 0.035)) gap_until = next + random_.uniform(6, shrubs ? 60 : 25);
          const GroundPoint position =
              line.points[i] + along * (next - travelled) + out * (side * offset + random_.uniform(-0.7, 0.7));
          if (!clear(position, 4.5)) continue;
          if (avenue) {
            const double radius = random_.uniform(2.6, 4.2);
            plant(position, radius, radius * 2.3, Plant::broadleaf);
          } else if (random_.chance(0.1)) {
            const double radius = random_.uniform(2.5, 5);
            plant(position, radius, radius * 2, Plant::broadleaf);
          } else {
            const double radius = random_.uniform(1.1, 2.1);
            plant(position, radius, radius * 1.8, Plant::bush);
          }
        }
        travelled += length;
      }
    }
  }

  void river_banks() {
    const Noise density(static_cast<std::uint64_t>(random_.uniform() * 0x1.0p53), 130);
    const auto& points = land_.river.points;
    for (std::size_t i = 0; i + 1 < points.size(); ++i) {
      const GroundPoint step = points[i + 1] - points[i];
      const GroundPoint out = GroundPoint(-step.y, step.x) * (1 / cv::norm(step));
      for (const double side : {-1.0, 1.0}) {
        for (int k = 0; k < 3; ++k) {
          const double from_river = side * (land_.river.half_widths_m[i] + random_.uniform(2, 15));
          const GroundPoint position = points[i] + step * random_.uniform() + out * from_river;
          if (density.at(position.x + side * 500, position.y) < random_.uniform(-0.25, 0.5) || !clear(position, 3))
            continue;
          const double radius = random_.uniform(1.3, 4.6);
          plant(position, radius, radius * 2.1, radius < 2 ? Plant::bush : Plant::broadleaf);
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
        const double y = (r + random_.uniform(0.1, 0.9)) * spacing;
        const GroundPoint position((c + random_.uniform(0.1, 0.9)) * spacing, y);
        const auto hit = land_.fields.find(land_.fields.uv_from_ground(position));
        visit(position, land_.fields.parcels[static_cast<std::size_t>(hit.parcel)], hit);
      }
    }
  }

  bool clear(GroundPoint position, double gap) const {
    for (const Polyline& road : land_.roads) {
      if (distance_m(road, position) < gap + 2.5) return false;
    }
    if (distance_m(land_.river, position) < 11) return false;
    for (const Pond& pond : land_.ponds) {
      if (pond.edge_m(position) < 1) return false;
    }
    for (const Plot& plot : land_.plots) {
      const GroundPoint d = position - plot.centre, axis(std::cos(plot.angle_rad), std::sin(plot.angle_rad));
      if (std::abs(d.dot(axis)) < plot.length_m / 2 + 1 &&
          std::abs(d.dot(GroundPoint(-axis.y, axis.x))) < plot.width_m / 2 + 1) {
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
  TreePlanter planter(random, land);
  planter.woods();
  planter.meadows();
  planter.orchards();
  planter.bales();
  planter.hedges(borders);
  planter.river_banks();
}

}  // namespace nadir
