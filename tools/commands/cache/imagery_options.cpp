#include "commands/cache/imagery_options.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <thread>

#include "base/plural.hpp"
#include "base/printable.hpp"
#include "cli/options.hpp"

namespace nadir {

void ImageryOptions::setup(Options& options) {
  options.value("--mosaic", mosaic_, "ORDER", "which raster lies on top: the first, the newest or the finest")
      .one_of({"priority", "newest", "finest"});
  options.value("--seam", seam_, "KIND", "transition between rasters").one_of({"hard", "feather"});
  options.value("--feather-m", feather_m_, "METRES", "width of a feathered seam").between(0.1, 1000);
  options.value("--threads", threads_, "N", "threads; default: one per processor").between(1, 256);
  options.value("--captured", captured_, "TIME", "capture time of the imagery, instead of the STAC Item's datetime");
  options.value("--gsd-m", gsd_m_, "METRES", "ground sample distance, instead of the STAC Item's")
      .between(1e-4, 1e4)
      .formerly("--gsd");
  options.value("--ce90-m", ce90_m_, "METRES", "90 % circular error, instead of the STAC Item's")
      .between(1e-4, 1e5)
      .formerly("--ce90");
  options.value("--provider", provider_, "NAME", "provider of the imagery, instead of the STAC Item's");
  options
      .value("--licence", licence_, "ID",
             "licence of the imagery, instead of the STAC Item's: an SPDX identifier, or unknown")
      .formerly("--license");
  options.value("--attribution", attribution_, "TEXT", "what the licence asks to be shown, instead of the STAC Item's");
}

MosaicOptions ImageryOptions::mosaic() const {
  const MosaicOrder order = mosaic_ == "newest"   ? MosaicOrder::newest
                            : mosaic_ == "finest" ? MosaicOrder::finest
                                                  : MosaicOrder::priority;
  return {order, seam_ == "feather" ? feather_m_ : 0};
}

int ImageryOptions::threads() const {
  return threads_.value_or(static_cast<int>(std::max(1U, std::thread::hardware_concurrency())));
}

void VectorOptions::setup(Options& options, std::string_view otherwise) {
  options.value("--vectors", file_, "FILE",
                fmt::format("roads, water, woods and buildings: .osm.pbf, GeoPackage or GeoJSON with OpenStreetMap's "
                            "tags; {}",
                            otherwise));
  options
      .value("--vectors-attribution", attribution_, "TEXT",
             "what their licence asks to be shown; default for .osm.pbf: OpenStreetMap's")
      .needs("--vectors");
  options.value("--vectors-licence", licence_, "ID", "SPDX identifier of their licence; default for .osm.pbf: ODbL-1.0")
      .needs("--vectors");
}

std::optional<VectorRequest> VectorOptions::request() const {
  if (!file_) return std::nullopt;
  return VectorRequest{*file_, attribution_, licence_};
}

std::string text_of(const SourceLicence& source) {
  const std::string text = fmt::format("{}: {}", source.source, source.licence);
  return printable(source.attribution.empty() ? text : text + ", " + source.attribution);
}

nlohmann::json json_of(const std::vector<SourceLicence>& sources) {
  nlohmann::json list = nlohmann::json::array();
  for (const SourceLicence& source : sources) {
    list.push_back({{"source", source.source}, {"licence", source.licence}, {"attribution", source.attribution}});
  }
  return list;
}

nlohmann::json json_of(const VectorFacts& vectors) {
  return {{"attribution", vectors.attribution},
          {"licence", vectors.licence},
          {"roads", vectors.roads},
          {"water", vectors.water},
          {"woods", vectors.woods},
          {"buildings", vectors.buildings}};
}

std::string text_of(const VectorFacts& vectors) {
  return fmt::format("{}, {} of water, {}, {}; {}, {}", count(vectors.roads, "road"), count(vectors.water, "feature"),
                     count(vectors.woods, "wood"), count(vectors.buildings, "building"), printable(vectors.attribution),
                     printable(vectors.licence));
}

}  // namespace nadir
