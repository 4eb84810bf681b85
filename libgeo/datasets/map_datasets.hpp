// Published datasets of aerial pictures with a map: each becomes flights as `nadir replay` reads them, and a
// georeferenced raster. Formats as their authors publish them, or as their own programs read them:
//
//   UAV-VisLoc   https://github.com/IntelliSensing/UAV-VisLoc (README; arXiv:2405.11936)
//     satellite_coordinates_range.csv (also with a blank, "satellite_ coordinates_range.csv", as it is distributed):
//       mapname, LT_lat_map, LT_lon_map, RB_lat_map, RB_lon_map: corners of each map, degrees
//     NN/NN.csv: filename, date, lat, lon, height; Omega (pitch), Kappa (roll), Phi1 (heading), degrees, which one
//       flight lacks
//     NN/drone/FILENAME, NN/satelliteNN.tif; one flight has its map in several files, satelliteNN_*.tif
//   WildNav      https://github.com/TIERS/wildnav (assets/, src/wildnav.py; arXiv:2210.09727)
//     map/map.csv: Filename, Top_left_lat, Top_left_lon, Bottom_right_lat, Bottom_right_long
//     query/photo_metadata.csv: Filename, Latitude, Longitude, Altitude (above take-off), Gimball_Roll, Gimball_Yaw,
//       Gimball_Pitch (-90: straight down), degrees, as DJI writes them; the pictures beside it
//   AnyVisLoc    https://github.com/UAV-AVL/Benchmark (avl_data.py, avl_utils.py, docs/GROUND_TRUTH.md)
//     Scene_NN/LNN_reference.json: modes.aerial and modes.satellite: map_path, map_resolution, map_origin_local,
//     dsm_path,
//       dsm_resolution, dsm_origin_local; metres
//     Scene_NN/LNN_MMMM.npz: image (or image_relpath), K, dist, xyz, euler_deg (roll, pitch off nadir, heading). The
//       local plane has x to the east and y to the SOUTH, as the rows of its maps; its place on the Earth is not
//       published and is taken to be 0° N, 0° E
//
// What a file leaves out or gets wrong is an Error with file, line and column (or array, or JSON pointer). What the
// formats do not say at all: docs/commands/evaluate.md.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "replay/flight_folder.hpp"
#include "replay/score.hpp"

namespace nadir {

struct DatasetFlight {
  std::string name;           // "03", "Scene_07"
  Flight flight;              // files: names, or absolute paths where they lie elsewhere
  Truth truth;                // one for each frame
  std::filesystem::path map;  // that RasterTiles reads
};

struct MapDatasetOptions {
  std::optional<std::filesystem::path> camera;  // camera.yaml, for datasets that state none
  std::vector<std::string> flights;             // by name; empty: all
  std::optional<std::size_t> max_frames;        // of each flight: evenly chosen, or the first ones
  bool in_sequence = false;                     // the first ones, with the times of the dataset
  double ground_m = 0;                          // is subtracted from the heights of UAV-VisLoc
  std::string reference = "aerial";             // of AnyVisLoc's two maps
  std::filesystem::path work;                   // a folder for what is unpacked and georeferenced
};

std::vector<DatasetFlight> read_uav_visloc(const std::filesystem::path& folder, const MapDatasetOptions& options);
// These have no times: in_sequence is a UsageError.
std::vector<DatasetFlight> read_wildnav(const std::filesystem::path& folder, const MapDatasetOptions& options);
// Frames whose cameras differ are flights of their own.
std::vector<DatasetFlight> read_anyvisloc(const std::filesystem::path& folder, const MapDatasetOptions& options);

}  // namespace nadir
