// The statements that create an empty catalogue: the texts of catalogue_spatialite.sql and catalogue_postgis.sql.
#pragma once

#include <string_view>

namespace nadir::catalogue_sql {

extern const std::string_view spatialite;
extern const std::string_view postgis;

}  // namespace nadir::catalogue_sql
