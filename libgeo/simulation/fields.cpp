#include "simulation/fields.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nadir {
namespace {

using Ring = std::vector<Spot>;

double area_of(const Ring& ring) {
  double twice = 0;
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const Spot &a = ring[i], &b = ring[(i + 1) % ring.size()];
    twice += a.x * b.y - a.y * b.x;
  }
  return std::abs(twice) / 2;
}

Spot middle_of(const Ring& ring) {
  Spot sum(0, 0);
  for (const Spot& p : ring) sum += p;
  return sum * (1.0 / static_cast<double>(ring.size()));
}

// Direction of the longest extent among 18 tried, and the extents along and across it.
struct Extent {
  double angle_rad = 0, length_m = 0, width_m = 0, low = 0, across_low = 0;
};

Extent along(const Ring& ring, double angle) {
  const Spot d(std::cos(angle), std::sin(angle)), n(-d.y, d.x);
  double l0 = 1e18, l1 = -1e18, w0 = 1e18, w1 = -1e18;
  for (const Spot& p : ring) {
    l0 = std::min(l0, p.dot(d)), l1 = std::max(l1, p.dot(d));
    w0 = std::min(w0, p.dot(n)), w1 = std::max(w1, p.dot(n));
  }
  return {angle, l1 - l0, w1 - w0, l0, w0};
}

Extent longest(const Ring& ring) {
  Extent best;
  double smallest = 1e18;
  for (std::size_t i = 0; i < ring.size(); ++i) {  // the smallest box has a side along an edge
    const Spot edge = ring[(i + 1) % ring.size()] - ring[i];
    if (edge.dot(edge) < 1) continue;
    Extent extent = along(ring, std::atan2(edge.y, edge.x));
    if (extent.width_m > extent.length_m) extent = along(ring, extent.angle_rad + std::numbers::pi / 2);
    const double box = extent.length_m * extent.width_m;
    if (box < smallest) smallest = box, best = extent;
  }
  return best;
}

// Sutherland-Hodgman: the part with sign·(p·n − offset) ≥ 0.
Ring clip(const Ring& ring, Spot normal, double offset, double sign) {
  Ring result;
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const Spot &a = ring[i], &b = ring[(i + 1) % ring.size()];
    const double da = sign * (a.dot(normal) - offset), db = sign * (b.dot(normal) - offset);
    if (da >= 0) result.push_back(a);
    if ((da < 0) != (db < 0)) result.push_back(a + (b - a) * (da / (da - db)));
  }
  return result;
}

class Divider {
 public:
  Divider(const Random& random, DividedLand& land) : random_(random.fork("fields")), land_(land) {}

  int divide(const Ring& ring, double target_m2, int strips) {
    const double area = area_of(ring);
    const Extent extent = longest(ring);
    const bool small = strips > 0 ? extent.width_m < 52 : area < target_m2;
    if (small || ring.size() < 3 || extent.width_m < 24) return add_parcel(ring, extent);
    if (strips == 0 && area < 90000 && area > 30000 && random_.chance(0.4)) strips = 1;
    if (strips > 0 && extent.length_m > 420) strips = 0;

    // Cut across the long side; strips are cut along it.
    double angle = extent.angle_rad + (strips > 0 ? std::numbers::pi / 2 : 0);
    const double jitter = area > 300000 ? 0.28 : area > 60000 ? 0.12 : 0.05;
    if (strips == 0 && extent.length_m < 1.25 * extent.width_m && random_.chance(0.5)) angle += std::numbers::pi / 2;
    angle += random_.uniform(-jitter, jitter) * (strips > 0 ? 0.2 : 1);
    const Spot normal(std::cos(angle), std::sin(angle));
    const Extent cut_extent = along(ring, angle);
    const double offset = cut_extent.low + cut_extent.length_m * random_.uniform(0.36, 0.64);

    Cut cut{normal, offset, Border::furrow, 0.3, {}};
    choose_border(cut, area);
    const Ring low = clip(ring, normal, offset, -1), high = clip(ring, normal, offset, 1);
    if (low.size() < 3 || high.size() < 3) return add_parcel(ring, extent);
    remember_border(ring, cut);
    const auto index = land_.pattern.cuts.size();
    land_.pattern.cuts.push_back(cut);
    const double next = target_m2 * random_.uniform(0.75, 1.33);
    const int below = divide(low, next, strips);
    const int above = divide(high, next, strips);
    land_.pattern.cuts[index].below = {below, above};
    return static_cast<int>(index);
  }

 private:
  void choose_border(Cut& cut, double area) {
    if (area > 700000) {
      cut.border = Border::road, cut.half_width_m = random_.uniform(2.4, 3.0);
    } else if (area > 150000) {
      cut.border = Border::track, cut.half_width_m = random_.uniform(1.4, 1.8);
    } else if (random_.chance(0.2)) {
      cut.border = Border::hedge, cut.half_width_m = 1.6;
    } else if (random_.chance(0.3)) {
      cut.border = Border::grass, cut.half_width_m = random_.uniform(0.8, 2.2);
    } else {
      cut.half_width_m = random_.uniform(0.2, 0.5);
    }
  }

  int add_parcel(const Ring& ring, const Extent& extent) {
    Parcel parcel;
    parcel.centre = middle_of(ring);
    parcel.row_angle_rad = extent.angle_rad;
    parcel.length_m = extent.length_m;
    parcel.area_m2 = area_of(ring);
    parcel.tone = random_.uniform(-1, 1);
    parcel.seed = hash_of(static_cast<std::uint64_t>(random_.uniform() * 0x1.0p53), 7);
    land_.pattern.parcels.push_back(parcel);
    return -static_cast<int>(land_.pattern.parcels.size());
  }

  void remember_border(const Ring& ring, const Cut& cut) {
    Ring ends;
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const Spot &a = ring[i], &b = ring[(i + 1) % ring.size()];
      const double da = a.dot(cut.normal) - cut.offset, db = b.dot(cut.normal) - cut.offset;
      if ((da < 0) != (db < 0)) ends.push_back(a + (b - a) * (da / (da - db)));
    }
    if (ends.size() != 2) return;
    BorderLine line{cut.border, {}};
    const int steps = std::max(1, static_cast<int>(cv::norm(ends[1] - ends[0]) / 12));
    for (int i = 0; i <= steps; ++i) {
      line.points.push_back(land_.pattern.ground_from_uv(ends[0] + (ends[1] - ends[0]) * (1.0 * i / steps)));
    }
    land_.borders.push_back(std::move(line));
  }

  Random random_;
  DividedLand& land_;
};

}  // namespace

Spot FieldPattern::uv_from_ground(Spot g) const {
  return {g.x + warp_m * warp_x.at(g.x, g.y), g.y + warp_m * warp_y.at(g.x, g.y)};
}

Spot FieldPattern::ground_from_uv(Spot uv) const {
  Spot ground = uv;
  for (int i = 0; i < 12; ++i) ground += uv - uv_from_ground(ground);
  return ground;
}

FieldPattern::Hit FieldPattern::find(Spot uv) const {
  Hit hit;
  int at = cuts.empty() ? -1 : 0;
  while (at >= 0) {
    const Cut& cut = cuts[static_cast<std::size_t>(at)];
    const double signed_m = uv.dot(cut.normal) - cut.offset;
    const double edge = std::abs(signed_m) - cut.half_width_m;
    if (edge < hit.border_m) hit.border_m = edge, hit.nearest_cut = at;
    if (cut.border == Border::road) hit.road_m = std::min(hit.road_m, edge);
    if (cut.border == Border::track) hit.track_m = std::min(hit.track_m, edge);
    at = cut.below[signed_m < 0 ? 0 : 1];
  }
  hit.parcel = -1 - at;
  return hit;
}

DividedLand divide_land(const Random& random, double size_m) {
  DividedLand land;
  Random own = random.fork("warp");
  land.pattern.warp_m = 52;
  land.pattern.warp_x = Noise(static_cast<std::uint64_t>(own.uniform() * 0x1.0p53), 640);
  land.pattern.warp_y = Noise(static_cast<std::uint64_t>(own.uniform() * 0x1.0p53), 640);
  const double rim = 260, tilt = own.uniform(-0.5, 0.5);
  const Spot centre(size_m / 2, size_m / 2);
  Ring ring;
  for (const Spot corner : {Spot(-1, -1), Spot(1, -1), Spot(1, 1), Spot(-1, 1)}) {
    const double reach = (size_m / 2 + rim) * (std::abs(std::cos(tilt)) + std::abs(std::sin(tilt)));
    const Spot p = corner * reach;
    ring.push_back(centre +
                   Spot(p.x * std::cos(tilt) - p.y * std::sin(tilt), p.x * std::sin(tilt) + p.y * std::cos(tilt)));
  }
  Divider(random, land).divide(ring, 24000, 0);
  return land;
}

void plant_crops(const Random& random, Landscape& land) {
  Random own = random.fork("crops");
  const Noise woods(static_cast<std::uint64_t>(own.uniform() * 0x1.0p53), 620);
  const Noise needles(static_cast<std::uint64_t>(own.uniform() * 0x1.0p53), 380);
  const Noise vines(static_cast<std::uint64_t>(own.uniform() * 0x1.0p53), 450);
  const auto arable = [&] {
    static constexpr std::array<double, kArableCrops> share = {0.27, 0.14, 0.14, 0.2, 0.09, 0.08, 0.08};
    double pick = own.uniform();
    for (int i = 0; i < kArableCrops; ++i) {
      pick -= share[static_cast<std::size_t>(i)];
      if (pick < 0) return static_cast<Crop>(i);
    }
    return Crop::wheat;
  };
  for (Parcel& parcel : land.fields.parcels) {
    const Spot place = land.fields.ground_from_uv(parcel.centre);
    const double river = distance_m(land.river, place), village = cv::norm(place - land.village);
    const double wood = woods.at(place.x, place.y) + own.uniform(-0.12, 0.12);
    if (wood > 0.36 && village > 330) {
      parcel.crop = needles.at(place.x, place.y) + own.uniform(-0.1, 0.1) > 0.18 ? Crop::conifers : Crop::wood;
    } else if (river < 75 ? own.chance(0.75) : own.chance(0.12)) {
      parcel.crop = own.chance(0.6) ? Crop::meadow : Crop::pasture;
    } else if (vines.at(place.x, place.y) > 0.42) {
      parcel.crop = own.chance(0.7) ? Crop::vineyard : Crop::orchard;
    } else if (own.chance(0.07)) {
      parcel.crop = Crop::fallow;
    } else if (parcel.area_m2 < 5000 && own.chance(0.35)) {
      parcel.crop = own.chance(0.5) ? Crop::orchard : Crop::meadow;
    } else {
      parcel.crop = arable();
    }
    parcel.crop_before = parcel.crop;
    if (static_cast<int>(parcel.crop) < kArableCrops) {
      if (own.chance(0.15)) parcel.crop = arable();  // sown with something else, or mulched and sown again
      if (own.chance(0.12)) parcel.half_done = own.uniform(0.25, 0.75);
    } else if (parcel.crop == Crop::meadow && own.chance(0.08)) {
      parcel.crop = arable();
    }
  }
}

}  // namespace nadir
