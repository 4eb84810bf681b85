// Everything that a build's result depends on, as lines "name: value": what a resumed build is compared with.
#pragma once

#include <span>
#include <string>
#include <string_view>

#include "raster/imagery_input.hpp"
#include "package_build/package_builder.hpp"

namespace nadir {

// Reads every file that the rasters are made of, to digest it.
std::string describe_build(const PackageRequest& request, std::string_view mission_text,
                           std::span<const ImageryInput> inputs);

}  // namespace nadir
