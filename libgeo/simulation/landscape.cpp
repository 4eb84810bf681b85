#include "simulation/landscape.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "base/random.hpp"
#include "simulation/landscape_objects.hpp"

namespace nadir {

double Relief::at(GroundPoint position) const {
  const double c = std::clamp(position.x / step_m - 0.5, 0.0, heights_m.cols - 1.001);
  const double r = std::clamp((size_m - position.y) / step_m - 0.5, 0.0, heights_m.rows - 1.001);
  const int ci = static_cast<int>(c), ri = static_cast<int>(r);
  const auto tc = static_cast<float>(c - ci), tr = static_cast<float>(r - ri);
  const float *a = heights_m[ri] + ci, *b = heights_m[ri + 1] + ci;
  return static_cast<double>((1 - tr) * ((1 - tc) * a[0] + tc * a[1]) + tr * ((1 - tc) * b[0] + tc * b[1]));
}

double Pond::edge_m(GroundPoint position) const {
  const GroundPoint d = position - centre;
  const double angle = std::atan2(d.y, d.x);
  double shape = 1;
  for (int k = 1; k <= 4; ++k) {
    const double phase = 6.283 * unit_hash(seed, k);
    shape += 0.16 / k * std::cos(k * angle + phase);
  }
  return cv::norm(d) - radius_m * shape;
}

double distance_m(const Polyline& line, GroundPoint position) {
  double best = 1e18;
  for (std::size_t i = 0; i + 1 < line.points.size(); ++i) {
    const GroundPoint a = line.points[i], ab = line.points[i + 1] - a, ap = position - a;
    const double t = std::clamp(ap.dot(ab) / std::max(ab.dot(ab), 1e-9), 0.0, 1.0);
    const GroundPoint gap = ap - ab * t;
    best = std::min(best, gap.dot(gap));
  }
  return std::sqrt(best);
}

std::vector<GroundPoint> smooth_curve(const std::vector<GroundPoint>& knots, double step_m) {
  std::vector<GroundPoint> points;
  const auto knot = [&](std::ptrdiff_t i) {
    return knots[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(i, 0, std::ssize(knots) - 1))];
  };
  for (std::ptrdiff_t i = 0; i + 1 < std::ssize(knots); ++i) {
    const GroundPoint a = knot(i - 1), b = knot(i), c = knot(i + 1), d = knot(i + 2);
    const int steps = std::max(1, static_cast<int>(cv::norm(c - b) / step_m));
    for (int s = 0; s < steps; ++s) {
      const double t = static_cast<double>(s) / steps;
      points.push_back((b * 2.0 + (c - a) * t + (a * 2.0 - b * 5.0 + c * 4.0 - d) * (t * t) +
                        (b * 3.0 - a - c * 3.0 + d) * (t * t * t)) *
                       0.5);
    }
  }
  points.push_back(knots.back());
  return points;
}

GroundPoint FieldPattern::uv_from_ground(GroundPoint g) const {
  return {g.x + warp_m * warp_x.at(g.x, g.y), g.y + warp_m * warp_y.at(g.x, g.y)};
}

GroundPoint FieldPattern::ground_from_uv(GroundPoint uv) const {
  GroundPoint ground = uv;
  for (int i = 0; i < 12; ++i) ground += uv - uv_from_ground(ground);
  return ground;
}

FieldPattern::Hit FieldPattern::find(GroundPoint uv) const {
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

namespace {

// The river, the main road and the ponds: curves across the whole world.
void lay_river_and_roads(const Random& random, Landscape& land) {
  Random own = random.fork("ways");
  const double size = land.size_m, rim = 200;
  const bool flip = own.chance(0.5), turn = own.chance(0.5);
  const auto place = [&](double x, double y) {  // from a drawing in which the river runs west to east
    if (flip) y = size - y;
    return turn ? GroundPoint(y, x) : GroundPoint(x, y);
  };
  // The river meanders about a sloping line.
  const double y0 = own.uniform(0.60, 0.74) * size, y1 = own.uniform(0.62, 0.8) * size;
  std::vector<GroundPoint> knots;
  double swing = own.chance(0.5) ? 1 : -1;
  for (double x = -rim; x < size + rim + 200; x += own.uniform(130, 210)) {
    const double along = std::clamp(x / size, 0.0, 1.0);
    knots.push_back(place(x, y0 + (y1 - y0) * along + swing * own.uniform(15, 75)));
    swing = own.chance(0.8) ? -swing : swing;
  }
  land.river.points = smooth_curve(knots, 8);
  const Noise width(static_cast<std::uint64_t>(own.uniform() * 0x1.0p53), 110);
  const double half = own.uniform(8, 12);
  for (const GroundPoint& p : land.river.points)
    land.river.half_widths_m.push_back(half * (1 + 0.45 * width.at(p.x, p.y)));

  // The main road crosses it and passes the village.
  const double village_y = own.uniform(0.36, 0.46) * size;
  const GroundPoint village(own.uniform(0.44, 0.54) * size, village_y);
  land.village = place(village.x, village.y);
  std::vector<GroundPoint> road;
  const double wave = 0.035 * size;
  road.push_back(place(own.uniform(0.15, 0.35) * size, -rim));
  road.push_back(place(village.x - own.uniform(0.02, 0.14) * size, village.y * 0.35));
  road.push_back(place(village.x - own.uniform(0, wave), village.y - 0.5 * 240));
  road.push_back(place(village.x, village.y));
  road.push_back(place(village.x + own.uniform(0, wave), village.y + 0.5 * 260));
  road.push_back(place(village.x + own.uniform(-wave, 2 * wave), (village.y + size) * 0.5));
  road.push_back(place(own.uniform(0.55, 0.8) * size, size * 0.86));
  road.push_back(place(own.uniform(0.6, 0.9) * size, size + rim));
  Polyline main;
  main.points = smooth_curve(road, 8);
  main.half_widths_m.assign(main.points.size(), 3.4);
  land.roads.push_back(std::move(main));

  const int ponds = std::max(1, static_cast<int>(size * size / 2.5e6));
  for (int i = 0; i < ponds; ++i) {
    const double y = own.uniform(0.1, 0.55) * size;
    const GroundPoint position = place(own.uniform(0.12, 0.88) * size, y);
    if (cv::norm(position - land.village) < 300 || distance_m(land.roads[0], position) < 90) continue;
    land.ponds.push_back({position, own.uniform(18, 42), hash_of(land.seed, 77, i)});
  }
}

// Rolling hills with a valley along the river.
Relief make_relief(const Random& random, double size_m, const Polyline& river) {
  Random own = random.fork("relief");
  Relief relief;
  relief.size_m = size_m;
  const int nodes = std::max(8, static_cast<int>(std::lround(size_m / 8)));
  relief.step_m = size_m / nodes;
  const PixelGrid grid{relief.step_m, size_m, 0, 0, nodes, nodes};
  relief.heights_m = cv::Mat_<float>(nodes, nodes, 338.0F);
  for (const auto& [wavelength, amplitude] : {std::pair{1700.0, 17.0}, {800.0, 9.0}, {330.0, 3.2}, {140.0, 0.8}}) {
    Noise(static_cast<std::uint64_t>(own.uniform() * 0x1.0p53), wavelength).add(grid, amplitude, relief.heights_m);
  }
  for (int row = 0; row < nodes; ++row) {
    for (int column = 0; column < nodes; ++column) {
      const double d = distance_m(river, {grid.x(column), grid.y(row)});
      const double valley = std::exp(-d * d / (2 * 330.0 * 330.0));
      float& h = relief.heights_m(row, column);
      h = static_cast<float>(static_cast<double>(h) * (1 - 0.75 * valley) + (338.0 - 19.0) * 0.75 * valley);
    }
  }
  return relief;
}

struct DividedLand {
  FieldPattern pattern;
  std::vector<BorderLine> borders;
};

using Ring = std::vector<GroundPoint>;

double area_of(const Ring& ring) {
  double twice = 0;
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const GroundPoint &a = ring[i], &b = ring[(i + 1) % ring.size()];
    twice += a.x * b.y - a.y * b.x;
  }
  return std::abs(twice) / 2;
}

GroundPoint middle_of(const Ring& ring) {
  GroundPoint sum(0, 0);
  for (const GroundPoint& p : ring) sum += p;
  return sum * (1.0 / static_cast<double>(ring.size()));
}

// Direction of the longest side of the smallest bounding box, and the extents along and across it.
struct Extent {
  double angle_rad = 0, length_m = 0, width_m = 0, low = 0, across_low = 0;
};

Extent along(const Ring& ring, double angle) {
  const GroundPoint d(std::cos(angle), std::sin(angle)), n(-d.y, d.x);
  double l0 = 1e18, l1 = -1e18, w0 = 1e18, w1 = -1e18;
  for (const GroundPoint& p : ring) {
    l0 = std::min(l0, p.dot(d)), l1 = std::max(l1, p.dot(d));
    w0 = std::min(w0, p.dot(n)), w1 = std::max(w1, p.dot(n));
  }
  return {angle, l1 - l0, w1 - w0, l0, w0};
}

Extent longest(const Ring& ring) {
  Extent best;
  double smallest = 1e18;
  for (std::size_t i = 0; i < ring.size(); ++i) {  // the smallest box has a side along an edge
    const GroundPoint edge = ring[(i + 1) % ring.size()] - ring[i];
    if (edge.dot(edge) < 1) continue;
    Extent extent = along(ring, std::atan2(edge.y, edge.x));
    if (extent.width_m > extent.length_m) extent = along(ring, extent.angle_rad + std::numbers::pi / 2);
    const double box = extent.length_m * extent.width_m;
    if (box < smallest) smallest = box, best = extent;
  }
  return best;
}

// Sutherland-Hodgman: the part with sign·(p·n − offset) ≥ 0.
Ring clip(const Ring& ring, GroundPoint normal, double offset, double sign) {
  Ring result;
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const GroundPoint &a = ring[i], &b = ring[(i + 1) % ring.size()];
    const double da = sign * (a.dot(normal) - offset), db = sign * (b.dot(normal) - offset);
    if (da >= 0) result.push_back(a);
    if ((da < 0) != (db < 0)) result.push_back(a + (b - a) * (da / (da - db)));
  }
  return result;
}

class Divider {
 public:
  Divider(const Random& random, DividedLand& land) : random_(random.fork("fields")), land_(land) {}

  // Returns the index of the cut, or −1 − the index of the parcel.
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
    const GroundPoint normal(std::cos(angle), std::sin(angle));
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
      const GroundPoint &a = ring[i], &b = ring[(i + 1) % ring.size()];
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

// Divides the land by recursive cuts of the warped plane.
DividedLand divide_land(const Random& random, double size_m) {
  DividedLand land;
  Random own = random.fork("warp");
  land.pattern.warp_m = 52;
  land.pattern.warp_x = Noise(static_cast<std::uint64_t>(own.uniform() * 0x1.0p53), 640);
  land.pattern.warp_y = Noise(static_cast<std::uint64_t>(own.uniform() * 0x1.0p53), 640);
  const double rim = 260, tilt = own.uniform(-0.5, 0.5);
  const GroundPoint centre(size_m / 2, size_m / 2);
  Ring ring;
  for (const GroundPoint corner : {GroundPoint(-1, -1), GroundPoint(1, -1), GroundPoint(1, 1), GroundPoint(-1, 1)}) {
    const double reach = (size_m / 2 + rim) * (std::abs(std::cos(tilt)) + std::abs(std::sin(tilt)));
    const GroundPoint p = corner * reach;
    ring.push_back(
        centre + GroundPoint(p.x * std::cos(tilt) - p.y * std::sin(tilt), p.x * std::sin(tilt) + p.y * std::cos(tilt)));
  }
  Divider(random, land).divide(ring, 24000, 0);
  return land;
}

// Chooses the crops; needs the river, the ponds and the village.
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
    const GroundPoint place = land.fields.ground_from_uv(parcel.centre);
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

}  // namespace

Landscape generate_landscape(std::uint64_t seed, double size_m) {
  const Random random(seed);
  Landscape land;
  land.seed = seed;
  land.size_m = size_m;
  lay_river_and_roads(random, land);
  land.relief = make_relief(random, size_m, land.river);
  DividedLand divided = divide_land(random, size_m);
  land.fields = std::move(divided.pattern);
  build_village(random, land);
  plant_crops(random, land);
  build_farms(random, land);
  plant_trees(random, divided.borders, land);
  return land;
}

}  // namespace nadir
