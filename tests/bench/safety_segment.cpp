#include "safety_segment.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <cmath>

#include "estimation/localizer.hpp"
#include "safety_judge.hpp"
#include "simulation/noise.hpp"

namespace nadir::bench {
namespace {

constexpr double kTellableSigmas = 4;  // the gate of the first anchor is 3.7, and the anchor itself errs

// On a map that is out of place from the start the flight looks like one that began elsewhere. Only a start that says
// otherwise could tell.
bool start_tells(const Flight& flight) {
  if (!flight.start) return false;
  const PlanePoint mapped = flight.shots.front().truth.position + flight.shift.vector();
  return (mapped - frame().plane_from_lonlat(*flight.start)).norm() > kTellableSigmas * flight.start_sigma_m;
}

}  // namespace

Segments::Segments(int worlds, std::uint64_t base_seed, FrameSpacing spacing, MapMatcherFactory matcher)
    : photographer_(camera_file().camera),
      worlds_(worlds, first_world_of(base_seed)),
      spacing_(spacing),
      matcher_(std::move(matcher)) {}

const TileSource& Segments::tiles_of(const Flight& flight) const {
  switch (flight.condition->fault) {
    case Fault::old_map: return *worlds_.old_maps[flight.world];
    case Fault::mirrored_map: return worlds_.all[flight.world]->mirrored_map;
    case Fault::other_region: return worlds_.neighbour(flight.world).map;
    default: return worlds_.all[flight.world]->map;
  }
}

Record Segments::run(std::uint64_t base_seed, std::uint64_t index,
                     const std::function<void(const std::string&)>& talk) const {
  const Flight flight =
      make_flight(hash_of(base_seed, static_cast<std::int64_t>(index)), worlds_.all, photographer_, spacing_);
  const World& world = *worlds_.all[flight.world];
  const TileSource& right = tiles_of(flight);
  const PictureTiles shifted(world.satellite, {.shift = flight.shift});
  const JoinedTiles joined(right, shifted, flight.border.value_or(Border{}));
  const bool whole = flight.condition->fault == Fault::map_shift, part = flight.border.has_value();
  const TileSource* map = whole ? static_cast<const TileSource*>(&shifted) : part ? &joined : &right;
  LocalizerConfig config = config_of(flight, world);
  config.matcher = matcher_;
  Localizer localizer(camera_file(), frame(), map, flight.start, config);

  Record record;
  record.index = index;
  record.condition = flight.condition->name;
  bool unknowable = false;
  std::vector<CameraPose> before;  // of the last two frames, the last one first
  if (talk) {
    talk(fmt::format("segment {}: {}, seed {}, world {}, start {}\n", index, record.condition, flight.seed,
                     flight.world, flight.start ? fmt::format("within {:.0f} m", flight.start_sigma_m) : "unknown"));
  }
  for (std::size_t i = 0; i < flight.shots.size(); ++i) {
    const Shot& shot = flight.shots[i];
    const bool unanchored = record.accepted == 0;
    if (shot.shifted && unanchored && !start_tells(flight)) unknowable = true;  // before anything was known
    const FrameReport report = localizer.process(shot.picture, shot.telemetry);
    judge(report, shot.truth, unknowable, record);
    judge_motion(report.odometry, shot.truth, before, record.motions);
    before.insert(before.begin(), shot.truth);
    before.resize(std::min<std::size_t>(before.size(), 2));
    if (talk) talk(frame_line(i, report, shot.truth));
  }
  return record;
}

}  // namespace nadir::bench
