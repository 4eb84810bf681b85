// A catalogue as a project of QGIS (3.22 or newer), and its styles for layers that are added to other projects.
//
// A project is an XML file (.qgs) that names each layer's source, filter and style; QGIS reads the data from the
// catalogue each time. Its layers are the catalogue's views: gaps, routes, sectors, packages with series and sequence
// as labels, coverage by age of the imagery, tiles; and candidate tiles by their verdict. Those of current packages are
// shown, earlier sequences are a layer that is switched off.
//
// A style alone is QGIS's QML. QGIS looks for the default style of a layer in the database's table layer_styles.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "catalogue/database.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {

struct QgisProject {
  CatalogueLocation packages;
  std::optional<CatalogueLocation> candidates;
  std::filesystem::path folder;     // where the project will be: paths of files are relative to it
  std::optional<LonLatBox> extent;  // the first view; none: the world
};

// Throws UsageError for a postgresql:// address: QGIS takes the connection string alone.
std::string qgis_project_xml(const QgisProject& project);

// Where the catalogue's packages and planned gaps are; none: there are none.
std::optional<LonLatBox> qgis_extent(CatalogueDatabase& catalogue);

// Replaces our rows in layer_styles, which is created where it is missing; other styles stay.
enum class QgisStyles { packages, candidates };
void store_qgis_styles(CatalogueDatabase& catalogue, const CatalogueLocation& location, QgisStyles styles);

}  // namespace nadir
