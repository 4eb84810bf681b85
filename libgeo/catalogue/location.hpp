// Where a catalogue is stored: a SpatiaLite file, or a PostgreSQL database with PostGIS.
#pragma once

#include <string>
#include <string_view>

namespace nadir {

struct CatalogueLocation {
  enum class Kind { file, postgres };
  Kind kind = Kind::file;
  std::string name;   // what GDAL opens
  std::string shown;  // the same for messages
};

// "PG:dbname=fleet host=…" (libpq's connection string) or "postgresql://…" is a database, anything else a file path.
// Throws UsageError for an empty text, for GDAL's virtual file systems, and for a password, which it does not show:
// other users read command lines.
CatalogueLocation parse_catalogue_location(const std::string& text);

}  // namespace nadir
