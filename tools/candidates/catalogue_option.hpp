// --data and --catalogue, as the commands that look at a service's catalogue take them.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "catalogue/location.hpp"

namespace nadir {

// Throws UsageError when neither is given.
CatalogueLocation catalogue_location(const std::string& catalogue, const std::optional<std::filesystem::path>& data);

}  // namespace nadir
