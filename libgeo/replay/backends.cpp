#include "replay/backends.hpp"

#include <string>

#include "base/error.hpp"

namespace nadir {

OdometryFactory odometry_named(std::string_view name) {
  if (name == "features") return make_feature_odometry;
  if (name == "flow") return make_flow_odometry;
  throw UsageError({.what = "unknown odometry front end",
                    .where = "--odometry",
                    .expected = "features or flow",
                    .found = std::string(name)});
}

MapMatcherFactory matcher_named(std::string_view name) {
  if (name == "channels") return make_channel_matcher;
  throw UsageError({.what = "unknown map matcher",
                    .where = "--matcher",
                    .expected = "channels",
                    .found = std::string(name)});
}

}  // namespace nadir
