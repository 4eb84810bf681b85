// The frames of a flight against the map, each by itself and beginning at GPS's position: what solve_boresight() needs.
// No filter is in between, which would carry one frame's error into the next.
#pragma once

#include <vector>

#include "base/progress.hpp"
#include "package/open_package.hpp"
#include "provision/boresight.hpp"
#include "replay/flight_folder.hpp"

namespace nadir {

struct BoresightFlight {
  const Flight& flight;  // frames with GPS's place; the attitudes are of a camera that is mounted like …
  Attitude told_mount;   // … this; zeros: they are the aircraft's own
  std::size_t most_frames = 150;
};

struct BoresightSights {
  std::vector<BoresightSight> sights;
  std::size_t looked_at = 0;  // frames that had all it takes, evenly chosen
};

// mount: how the camera is believed to sit; looked for up to some ten degrees around.
BoresightSights find_sights(const BoresightFlight& from, const CameraFile& camera, const Attitude& mount,
                            const OpenPackage& package, Progress& progress);

}  // namespace nadir
