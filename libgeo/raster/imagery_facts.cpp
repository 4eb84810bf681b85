#include "raster/imagery_facts.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/json.hpp"

namespace nadir {
namespace {

using nlohmann::json;

class Item {
 public:
  explicit Item(const std::filesystem::path& raster) : path_(stac_item_beside(raster)) {
    if (!std::filesystem::exists(path_)) return;
    const json document = parse_json(read_text_file(path_), path_.string());
    if (!document.is_object() || document.value("type", json()) != "Feature" || !document.contains("properties") ||
        !document["properties"].is_object()) {
      throw UsageError({.what = "this is no STAC Item",
                        .where = path_.string(),
                        .expected = "a GeoJSON Feature with properties",
                        .fix = "see docs/commands/cache-build.md for an example"});
    }
    properties_ = document["properties"];
  }

  [[noreturn]] void missing(std::string_view fact, std::string_view option) const {
    const bool there = properties_.is_object();
    throw UsageError({.what = fmt::format("the imagery's {} is not known", fact),
                      .where = path_.string(),
                      .expected = fmt::format("a STAC Item beside the raster that states it, or {}", option),
                      .found = there ? "an item without it" : "no such file",
                      .fix = fmt::format("add it to the item, or give {}", option)});
  }

  double positive(std::string_view name, std::string_view fact, std::string_view option) const {
    const json value = property(name);
    if (value.is_null()) missing(fact, option);
    if (!value.is_number() || value.get<double>() <= 0) reject(name, "a positive number of metres", value);
    return value.get<double>();
  }

  UtcTime datetime() const {
    const json value = property("datetime");
    if (value.is_null()) missing("capture time", "--captured");
    const auto time = value.is_string() ? parse_utc(value.get<std::string>()) : std::nullopt;
    if (!time) reject("datetime", "a time as RFC 3339 writes it", value);
    return *time;
  }

  std::string provider() const {
    const json value = property("providers");
    if (!value.is_array() || value.empty() || !value[0].is_object() || !value[0].contains("name")) {
      missing("provider", "--provider");
    }
    if (!value[0]["name"].is_string()) reject("providers[0].name", "a text", value[0]["name"]);
    return value[0]["name"].get<std::string>();
  }

 private:
  json property(std::string_view name) const {
    return properties_.is_object() && properties_.contains(name) ? properties_[std::string(name)] : json();
  }

  [[noreturn]] void reject(std::string_view name, std::string_view expected, const json& found) const {
    throw UsageError({.what = "the STAC Item does not read",
                      .where = fmt::format("{} (properties.{})", path_.string(), name),
                      .expected = std::string(expected),
                      .found = found.dump()});
  }

  std::filesystem::path path_;
  json properties_;
};

}  // namespace

std::filesystem::path stac_item_beside(const std::filesystem::path& raster) {
  std::filesystem::path item = raster;
  return item.replace_extension(".json");
}

ImageryFacts read_imagery_facts(const std::filesystem::path& raster, const ImageryOverrides& overrides) {
  const Item item(raster);
  return {
      .captured_at = overrides.captured_at ? *overrides.captured_at : item.datetime(),
      .gsd_m = overrides.gsd_m ? *overrides.gsd_m : item.positive("gsd", "ground sample distance", "--gsd"),
      .ce90_m = overrides.ce90_m ? *overrides.ce90_m : item.positive("nadir:ce90_m", "accuracy (CE90)", "--ce90"),
      .provider = overrides.provider ? *overrides.provider : item.provider(),
  };
}

}  // namespace nadir
