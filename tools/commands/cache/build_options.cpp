#include "commands/cache/build_options.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <ostream>

#include "cli/nadir_version.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"

namespace nadir {

void BuildOptions::setup(Options& options) {
  options.value("--mission", mission_, "MISSION.yaml", "mission that the map is for").required();
  options.values("--imagery", imagery_, "FILE", "georeferenced rasters that GDAL reads; the first lies on top")
      .required();
  options.values("--stretch", stretches_, "MIN,MAX",
                 "values of 16-bit or float imagery that become black and white, or percentile:LOW,HIGH; one for all, "
                 "or one for each --imagery (none for an 8-bit one)");
  options.values("--dem", dem_, "FILE",
                 "elevation models in metres that GDAL reads, for terrain: {mode: dem}; the first lies on top");
  vectors_.setup(options, "without it the package has none");
  options.value("--format", format_, "FORMAT", "tile container").one_of({"mbtiles", "cog"});
  options.value("--tile-format", tile_format_, "FORMAT", "encoding of the tiles").one_of({"jpeg", "webp", "png"});
  options.value("--quality", quality_, "N", "quality of JPEG and WebP tiles").between(1, 100);
  imagery_options_.setup(options);
  options.value(
      "--at", at_, "TIME",
      "evaluate ages, and whether the mission has expired, as of this time; default: ages as of its `created`");
}

PackageRequest BuildOptions::request() const {
  PackageRequest request;
  request.mission = mission_;
  request.imagery = imagery_;
  request.overrides = imagery_options_.overrides();
  for (const std::string& text : stretches_) request.stretches.push_back(parse_stretch(text));
  request.dem = dem_;
  request.vectors = vectors_.request();
  request.tiles.encoding = {parse_image_format(tile_format_).value_or(ImageFormat::jpeg), quality_};
  if (format_ == "cog") {
    request.tiles.container = TileSetKind::cog;
    // TIFF knows no PNG: the tiles are as lossless as WebP.
    if (tile_format_ == "png") request.tiles.encoding = {ImageFormat::webp, quality_, true};
  }
  request.tiles.threads = imagery_options_.threads();
  request.tiles.mosaic = imagery_options_.mosaic();
  request.at = at_;
  request.program = kVersion;
  return request;
}

void print_package(Context& context, const std::filesystem::path& package, const PackageReport& report,
                   const PrivateKey* key) {
  if (context.json) {
    nlohmann::json more = {{"package", package.string()},     {"tiles", report.tiles},
                           {"resumed_tiles", report.resumed}, {"bytes", report.bytes},
                           {"min_zoom", report.zoom.min},     {"max_zoom", report.zoom.max},
                           {"signed", key != nullptr},        {"merkle_root", report.merkle_root.hex()}};
    if (report.vectors) more["vectors"] = json_of(*report.vectors);
    if (report.terrain) more["terrain"] = {{"columns", report.terrain->columns}, {"rows", report.terrain->rows}};
    report_findings(context.out, true, report.findings, more);
    return;
  }
  if (!report.findings.empty()) print_findings(context.out, report.findings);
  print_figures(
      context.out,
      {{"package", package.string()},
       {"tiles", fmt::format("{} (zoom {} to {})", report.tiles, report.zoom.min, report.zoom.max)},
       {"terrain", report.terrain ? fmt::format("{} x {} heights", report.terrain->columns, report.terrain->rows)
                                  : std::string("flat")},
       {"vectors", report.vectors ? text_of(*report.vectors) : std::string("none")},
       {"size", fmt::format("{:.1f} MB", static_cast<double>(report.bytes) / 1e6)},
       {"merkle root", report.merkle_root.hex()},
       {"signed by", key != nullptr ? key->public_key().id() : "unsigned"}});
  if (key == nullptr && !context.quiet) {
    context.err << "The package is not signed. Aircraft accept only signed packages: nadir cache sign PACKAGE "
                   "--key KEY.pem\n";
  }
}

}  // namespace nadir
