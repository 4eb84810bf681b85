#include "candidates/catalogue_option.hpp"

#include "base/error.hpp"

namespace nadir {

CatalogueLocation catalogue_location(const std::string& catalogue, const std::optional<std::filesystem::path>& data) {
  if (!catalogue.empty()) return parse_catalogue_location(catalogue);
  if (data) return parse_catalogue_location((*data / "catalogue.sqlite").string());
  throw UsageError({.what = "no catalogue is named", .expected = "--data DIR or --catalogue CATALOGUE"});
}

}  // namespace nadir
