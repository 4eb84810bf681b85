// The statements that make an empty catalogue: the texts of catalogue_spatialite.sql and catalogue_postgis.sql.
#pragma once

#include <string_view>

namespace nadir::candidate_sql {

extern const std::string_view spatialite;
extern const std::string_view postgis;

}  // namespace nadir::candidate_sql
