// `nadir cache build`: mission, imagery and elevation model to a signed package.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/nadir_version.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/cache/imagery_options.hpp"
#include "commands/cache/package_signer.hpp"
#include "commands/commands.hpp"
#include "package_build/package_builder.hpp"
#include "token_keys/token_key.hpp"

namespace nadir {
namespace {

class CacheBuildCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "build"; }
  std::string_view summary() const override { return "build and sign the map package of a mission"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path mission_;
  std::vector<std::filesystem::path> imagery_;
  std::vector<std::string> stretches_;
  std::optional<std::filesystem::path> dem_;
  std::string format_ = "mbtiles";
  std::string tile_format_ = "jpeg";
  int quality_ = 75;
  VectorOptions vectors_;
  ImageryOptions imagery_options_{"priority"};
  std::optional<std::filesystem::path> key_;
  std::vector<std::filesystem::path> roots_;
  std::optional<std::filesystem::path> trust_;
  std::optional<UtcTime> at_;
  std::filesystem::path out_;
  bool resume_ = false;
};

std::string_view CacheBuildCommand::details() const {
  return R"(Warps the imagery to map tiles at the mission's zooms, with overviews, masks and a sidecar per
tile, writes the manifest and signs it. What `cache verify` would reject is rejected here: gaps in
the area that the mission requires, imagery that is too old or too coarse, a package larger than
the budget. The findings are printed, the exit code is 1 and no output is left behind.

Capture time, GSD, provider and CE90 are read from the STAC Item beside each raster (map.tif +
map.json). Where rasters overlap, the first one named lies on top, or the newest or finest
(--mosaic). With --seam feather it fades into the next one over --feather-m metres.

8-bit imagery keeps its values. 16-bit and float imagery needs --stretch: one linear mapping from
MIN, black, to MAX, white, for all bands; the values used become part of each tile's source.

A mission with terrain: {mode: dem} needs an elevation model (--dem). It is cropped to the
mission's area plus a margin and becomes terrain/dem.tif of the package.

--vectors adds roads, water, woods and buildings, cut to the mission and simplified to the tiles'
resolution, as vectors/vectors.geojson: the pages draw them, and water informs `cache matchability`.

--carry-root adds newer roots of trust to the package, so that an aircraft that holds their
predecessor learns of new and revoked keys; each must be signed by its predecessor, the first one
by the root that --trust names.

The same inputs and the same key give the same bytes, whatever the number of threads. A build that
was killed, or ran out of disk space, continues with --resume and gives the same bytes as well.)";
}

std::string_view CacheBuildCommand::examples() const {
  return R"(nadir cache build --mission mission.yaml --imagery map.tif --key planner.key.pem --out package
nadir cache build --mission mission.yaml --imagery map.tif --dem dem.tif --key planner.key.pem --out package
nadir cache build --mission mission.yaml --imagery map.tif --vectors region.osm.pbf --key planner.key.pem --out package
nadir cache build --mission mission.yaml --imagery new.tif --imagery old.tif --tile-format webp --out package
nadir cache build --mission mission.yaml --imagery map.tif --captured 2024-03-01 --gsd-m 0.3 --ce90-m 5 --provider survey --out package)";
}

void CacheBuildCommand::setup(Options& options) {
  options.value("--mission", mission_, "MISSION.yaml", "mission that the map is for").required();
  options.values("--imagery", imagery_, "FILE", "georeferenced rasters that GDAL reads; the first lies on top")
      .required();
  options.values("--stretch", stretches_, "MIN,MAX",
                 "values of 16-bit or float imagery that become black and white, or percentile:LOW,HIGH; one for all, "
                 "or one for each --imagery (none for an 8-bit one)");
  options.value("--dem", dem_, "FILE", "elevation model in metres that GDAL reads; for terrain: {mode: dem}");
  vectors_.setup(options, "without it the package has none");
  options.value("--format", format_, "FORMAT", "tile container").one_of({"mbtiles", "cog"});
  options.value("--tile-format", tile_format_, "FORMAT", "encoding of the tiles").one_of({"jpeg", "webp", "png"});
  options.value("--quality", quality_, "N", "quality of JPEG and WebP tiles").between(1, 100);
  imagery_options_.setup(options);
  options.value("--key", key_, "KEY.pem", "private key that signs the package; without it the package is unsigned");
  options.values("--carry-root", roots_, "N.root.json", "newer root of trust to add to the package");
  options.value(
      "--trust", trust_, "ROOT.json",
      "root that the aircraft hold: the key must be one of its package signers, and added roots follow from it");
  options.value(
      "--at", at_, "TIME",
      "evaluate ages, and whether the mission has expired, as of this time; default: ages as of its `created`");
  options.value("--out", out_, "PACKAGE", "package folder to create; must not exist").required();
  options.flag("--resume", resume_, "resume a build that was killed, with the same inputs and options");
}

int CacheBuildCommand::run(Context& context) {
  std::optional<PrivateKey> key;
  if (key_) key = read_signing_key(*key_);
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
  request.key = key ? &*key : nullptr;
  std::optional<TrustRoot> installed;
  if (trust_) installed = read_trusted_root(*trust_);
  if (key) require_package_signer(*key, installed, roots_, context);
  request.roots = read_root_chain(roots_, evaluation_time(at_, context.clock), {}, installed ? &*installed : nullptr);
  request.at = at_;
  if (!at_) request.now = context.clock.now();
  request.out = out_;
  request.program = kVersion;
  request.resume = resume_;
  if (!context.quiet)
    request.on_remark = [&context](std::string_view remark) { context.err << printable(remark) << '\n'; };

  const PackageReport report = build_package(request, context.progress);
  if (report.findings.has_errors()) {
    if (!context.quiet) context.err << "rejected: nothing was written\n";
    return report_findings(context.out, context.json, report.findings);
  }
  if (context.json) {
    nlohmann::json more = {{"package", out_.string()},        {"tiles", report.tiles},
                           {"resumed_tiles", report.resumed}, {"bytes", report.bytes},
                           {"min_zoom", report.zoom.min},     {"max_zoom", report.zoom.max},
                           {"signed", key.has_value()},       {"merkle_root", report.merkle_root.hex()}};
    if (report.vectors) more["vectors"] = json_of(*report.vectors);
    if (report.terrain) more["terrain"] = {{"columns", report.terrain->columns}, {"rows", report.terrain->rows}};
    return report_findings(context.out, true, report.findings, more);
  }
  if (!report.findings.empty()) print_findings(context.out, report.findings);
  print_figures(
      context.out,
      {{"package", out_.string()},
       {"tiles", fmt::format("{} (zoom {} to {})", report.tiles, report.zoom.min, report.zoom.max)},
       {"terrain", report.terrain ? fmt::format("{} x {} heights", report.terrain->columns, report.terrain->rows)
                                  : std::string("flat")},
       {"vectors", report.vectors ? text_of(*report.vectors) : std::string("none")},
       {"size", fmt::format("{:.1f} MB", static_cast<double>(report.bytes) / 1e6)},
       {"merkle root", report.merkle_root.hex()},
       {"signed by", key ? key->public_key().id() : "unsigned"}});
  if (!key && !context.quiet) {
    context.err << "The package is not signed. Aircraft accept only signed packages: nadir cache sign PACKAGE "
                   "--key KEY.pem\n";
  }
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_cache_build() { return std::make_unique<CacheBuildCommand>(); }

}  // namespace nadir
