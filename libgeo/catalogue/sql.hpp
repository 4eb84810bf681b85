// The statements that create an empty catalogue, and its views: the texts of catalogue_*.sql.
#pragma once

#include <string_view>

namespace nadir::catalogue_sql {

extern const std::string_view spatialite;
extern const std::string_view postgis;
extern const std::string_view spatialite_views;
extern const std::string_view postgis_views;

}  // namespace nadir::catalogue_sql
