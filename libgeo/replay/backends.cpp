#include "replay/backends.hpp"

#include <string>

#include "base/error.hpp"

namespace nadir {

OdometryFactory odometry_named(std::string_view name) {
  if (name == "features") return make_feature_odometry;
  throw UsageError({.what = "there is no such odometry front end",
                    .where = "--odometry",
                    .expected = "features",
                    .found = std::string(name)});
}

MapMatcherFactory matcher_named(std::string_view name) {
  if (name == "channels") return make_channel_matcher;
  if (name == "sift") return make_sift_matcher;
  throw UsageError({.what = "there is no such place matcher",
                    .where = "--matcher",
                    .expected = "channels or sift",
                    .found = std::string(name)});
}

}  // namespace nadir
