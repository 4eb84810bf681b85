// Roads, water, woods and buildings from a file of OpenStreetMap's data or of a GIS program, for a package.
//
// GDAL reads .osm.pbf and .osm, GeoPackage, GeoJSON, Shapefiles and FlatGeobuf. A feature counts by its tags, as
// OpenStreetMap has them: columns of these names, "other_tags" (GDAL's hstore of the rest), or "fclass" (Geofabrik's
// extracts):
//
//   road      lines      highway=* but what is planned or under construction, railway=*
//   water     areas      natural=water, water=*, waterway=riverbank|dock, landuse=reservoir|basin
//             lines      waterway=river|canal|stream|drain|ditch
//   wood      areas      natural=wood, landuse=forest
//   building  areas      building=*
//
// They are cut to the sectors and the corridor with the margin of the tiles (kMargin_m), simplified to one pixel of the
// mission's finest zoom (Douglas and Peucker 1973), and rounded to 1e-7 degrees. What becomes smaller than a pixel is
// left out. The same file and mission give the same bytes.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "base/error.hpp"
#include "package/manifest.hpp"
#include "package/mission.hpp"

namespace nadir {

struct VectorRequest {
  std::filesystem::path file;
  // Of the file's data. OpenStreetMap's own formats have OpenStreetMap's; for any other file they have to be stated.
  std::optional<std::string> attribution, licence;
};

struct PackageVectors {
  std::string text;  // the file of the package
  VectorFacts facts;
};

// Adds "vectors.elsewhere", a warning, where nothing of the file lies in the mission's area. Throws UsageError for a
// file that is none of these, is not georeferenced, has too much in it, or whose licence is not known.
PackageVectors cut_vectors(const VectorRequest& request, const Mission& mission, Findings& findings);

// Checked before the work: what is stated, or OpenStreetMap's. Throws UsageError.
struct VectorOrigin {
  std::string attribution, licence;
};
VectorOrigin origin_of(const VectorRequest& request);

}  // namespace nadir
