#include "simulation/world_vectors.hpp"

#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <vector>

namespace nadir {
namespace {

using Outline = std::vector<GroundPoint>;

constexpr double kStep_m = 12;  // between points of a border that is straight in the warped plane
constexpr int kPondPoints = 48;

class WorldVectors {
 public:
  WorldVectors(const Landscape& land, const std::function<LonLat(GroundPoint)>& lonlat)
      : land_(land), lonlat_(lonlat) {}

  std::string write() {
    for (const Polyline& road : land_.roads) {
      add_line(road.points, "highway", &road == &land_.roads.front() ? "secondary" : "residential");
    }
    for (const Polyline& lane : land_.lanes) add_line(lane.points, "highway", "track");
    const double reach = 2 * land_.size_m;
    const GroundPoint middle(land_.size_m / 2, land_.size_m / 2);
    if (!land_.fields.cuts.empty()) {
      walk({middle + GroundPoint(-reach, -reach), middle + GroundPoint(reach, -reach),
            middle + GroundPoint(reach, reach), middle + GroundPoint(-reach, reach)},
           0);
    }
    add_line(land_.river.points, "waterway", "river");
    add_area(banks(land_.river), "natural", "water");
    for (const Pond& pond : land_.ponds) add_area(shore(pond), "natural", "water");
    for (const Building& building : land_.buildings) {
      if (building.presence == Presence::both) add_area(walls(building), "building", "yes");
    }
    return "{\"type\":\"FeatureCollection\",\"features\":[" + text_ + "\n]}\n";
  }

 private:
  static Outline clip(const Outline& ring, const Cut& cut, double sign) {
    Outline result;
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const GroundPoint &a = ring[i], &b = ring[(i + 1) % ring.size()];
      const double da = sign * (a.dot(cut.normal) - cut.offset), db = sign * (b.dot(cut.normal) - cut.offset);
      if (da >= 0) result.push_back(a);
      if ((da < 0) != (db < 0)) result.push_back(a + (b - a) * (da / (da - db)));
    }
    return result;
  }

  // A straight line of the warped plane on the ground; without its end.
  void append_on_ground(GroundPoint from, GroundPoint to, Outline& points) const {
    const int steps = std::max(1, static_cast<int>(cv::norm(to - from) / kStep_m));
    for (int i = 0; i < steps; ++i)
      points.push_back(land_.fields.ground_from_uv(from + (to - from) * (1.0 * i / steps)));
  }

  // Down the cuts, with the part of the plane that each divides.
  void walk(const Outline& ring, int at) {
    if (ring.size() < 3) return;
    if (at < 0) {
      const Parcel& parcel = land_.fields.parcels[static_cast<std::size_t>(-1 - at)];
      if (parcel.crop != Crop::wood && parcel.crop != Crop::conifers) return;
      Outline outline;
      for (std::size_t i = 0; i < ring.size(); ++i) append_on_ground(ring[i], ring[(i + 1) % ring.size()], outline);
      add_area(outline, "natural", "wood");
      return;
    }
    const Cut& cut = land_.fields.cuts[static_cast<std::size_t>(at)];
    if (cut.border == Border::road || cut.border == Border::track) {
      Outline ends, line;
      for (std::size_t i = 0; i < ring.size(); ++i) {
        const GroundPoint &a = ring[i], &b = ring[(i + 1) % ring.size()];
        const double da = a.dot(cut.normal) - cut.offset, db = b.dot(cut.normal) - cut.offset;
        if ((da < 0) != (db < 0)) ends.push_back(a + (b - a) * (da / (da - db)));
      }
      if (ends.size() == 2) {
        append_on_ground(ends[0], ends[1], line);
        line.push_back(land_.fields.ground_from_uv(ends[1]));
        add_line(line, "highway", cut.border == Border::road ? "unclassified" : "track");
      }
    }
    walk(clip(ring, cut, -1), cut.below[0]);
    walk(clip(ring, cut, 1), cut.below[1]);
  }

  static Outline banks(const Polyline& river) {
    Outline left, right;
    const std::size_t n = river.points.size();
    for (std::size_t i = 0; i < n; ++i) {
      const GroundPoint along = river.points[std::min(i + 1, n - 1)] - river.points[i == 0 ? 0 : i - 1];
      const double length = std::max(1e-9, cv::norm(along));
      const GroundPoint across(-along.y / length * river.half_widths_m[i], along.x / length * river.half_widths_m[i]);
      left.push_back(river.points[i] + across);
      right.push_back(river.points[i] - across);
    }
    left.insert(left.end(), right.rbegin(), right.rend());
    return left;
  }

  static Outline shore(const Pond& pond) {
    Outline outline;
    for (int i = 0; i < kPondPoints; ++i) {
      const double angle = 2 * std::numbers::pi * i / kPondPoints;
      const GroundPoint direction(std::cos(angle), std::sin(angle));
      double inside = 0, outside = 3 * pond.radius_m;
      for (int k = 0; k < 30; ++k) {
        const double middle = (inside + outside) / 2;
        (pond.edge_m(pond.centre + direction * middle) < 0 ? inside : outside) = middle;
      }
      outline.push_back(pond.centre + direction * inside);
    }
    return outline;
  }

  static Outline walls(const Building& building) {
    const double c = std::cos(building.angle_rad), s = std::sin(building.angle_rad);
    const GroundPoint along(c * building.length_m / 2, s * building.length_m / 2),
        across(-s * building.width_m / 2, c * building.width_m / 2);
    return {building.centre - along - across, building.centre + along - across, building.centre + along + across,
            building.centre - along + across};
  }

  std::string points_text(const Outline& points) const {
    std::string text;
    for (const GroundPoint& point : points) {
      const LonLat place = lonlat_(point);
      text += fmt::format("{}[{:.7f},{:.7f}]", text.empty() ? "" : ",", place.lon_deg, place.lat_deg);
    }
    return text;
  }
  void add_line(const Outline& points, const char* key, const char* value) {
    if (points.size() > 1) add("LineString", "[" + points_text(points) + "]", key, value);
  }
  void add_area(Outline outline, const char* key, const char* value) {
    if (outline.size() < 3) return;
    outline.push_back(outline.front());
    add("Polygon", "[[" + points_text(outline) + "]]", key, value);
  }
  void add(const char* type, const std::string& coordinates, const char* key, const char* value) {
    text_ +=
        fmt::format(R"({}{{"type":"Feature","properties":{{"{}":"{}"}},"geometry":{{"type":"{}","coordinates":{}}}}})",
                    text_.empty() ? "\n" : ",\n", key, value, type, coordinates);
  }

  const Landscape& land_;
  const std::function<LonLat(GroundPoint)>& lonlat_;
  std::string text_;
};

}  // namespace

std::string world_vectors(const Landscape& land, const std::function<LonLat(GroundPoint)>& lonlat) {
  return WorldVectors(land, lonlat).write();
}

}  // namespace nadir
