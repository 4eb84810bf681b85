#include "package_build/matchability_summary.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace nadir {
namespace {

constexpr double kStep_m = 5;  // the route is looked at this often; cells are tens of metres wide

std::size_t index_of(MatchClass cls) { return static_cast<std::size_t>(cls); }

class RouteWalk {
 public:
  RouteWalk(const MatchabilityMap& map, const LocalFrame& frame, MatchabilitySummary& summary)
      : map_(map), frame_(frame), summary_(summary) {}

  void leg(PlanePoint from, PlanePoint to) {
    const double length = std::hypot(to.east_m - from.east_m, to.north_m - from.north_m);
    const int steps = std::max(1, static_cast<int>(std::ceil(length / kStep_m)));
    const auto along = [&](double share) {
      return frame_.lonlat_from_enu(from.east_m + share * (to.east_m - from.east_m),
                                    from.north_m + share * (to.north_m - from.north_m));
    };
    for (int i = 0; i < steps; ++i) {
      const PlaceMatchability* place = map_.at(along((i + 0.5) / steps));
      const MatchClass cls = place == nullptr ? MatchClass::outside : place->cls;
      step(cls, along(static_cast<double>(i) / steps), along((i + 1.0) / steps), length / steps);
    }
  }

 private:
  void step(MatchClass cls, LonLat from, LonLat to, double length_m) {
    summary_.route_m[index_of(cls)] += length_m;
    if (cls != MatchClass::good) {
      if (!open_) summary_.without_good.push_back({from, from, at_m_, 0});
      summary_.without_good.back().to = to;
      summary_.without_good.back().length_m += length_m;
    }
    open_ = cls != MatchClass::good;
    at_m_ += length_m;
  }

  const MatchabilityMap& map_;
  const LocalFrame& frame_;
  MatchabilitySummary& summary_;
  double at_m_ = 0;
  bool open_ = false;
};

}  // namespace

std::size_t MatchabilitySummary::places() const { return std::accumulate(cells.begin(), cells.end(), std::size_t{0}); }

double MatchabilitySummary::share(MatchClass cls) const {
  return places() == 0 ? 0 : static_cast<double>(cells[index_of(cls)]) / static_cast<double>(places());
}

double MatchabilitySummary::route_length_m() const { return std::accumulate(route_m.begin(), route_m.end(), 0.0); }

double MatchabilitySummary::route_share(MatchClass cls) const {
  const double length = route_length_m();
  return length > 0 ? route_m[index_of(cls)] / length : 0;
}

MatchabilitySummary summarise(const MatchabilityMap& map, const std::vector<LonLat>& route, const LocalFrame& frame) {
  MatchabilitySummary summary;
  for (const PlaceMatchability& cell : map.cells) {
    if (cell.cls != MatchClass::outside) ++summary.cells[index_of(cell.cls)];
  }
  RouteWalk walk(map, frame, summary);
  const PlaneRing path = to_plane(frame, route);
  for (std::size_t i = 1; i < path.size(); ++i) walk.leg(path[i - 1], path[i]);
  std::stable_sort(summary.without_good.begin(), summary.without_good.end(),
                   [](const RouteStretch& a, const RouteStretch& b) { return a.length_m > b.length_m; });
  return summary;
}

}  // namespace nadir
