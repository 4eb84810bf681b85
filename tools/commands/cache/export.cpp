// nadir cache export: the imagery of a package for other programs.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>

#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "package_export/tile_export.hpp"
#include "trust/root.hpp"

namespace nadir {
namespace {

class CacheExportCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "export"; }
  std::string_view summary() const override { return "write a package's imagery for ground stations and GIS"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path package_, trust_, out_;
  std::string format_;
  std::optional<UtcTime> at_;
};

std::string_view CacheExportCommand::details() const {
  return R"(The operator sees the very map that the aircraft flies with: tiles leave bit for bit, nothing is
compressed again. The package is verified (full) first; the output is read back and compared with
the signed digests before it appears under its name.

  pmtiles          one file: web maps, MapLibre, QGIS, QGroundControl
  gpkg             OGC GeoPackage: QGIS, ArcGIS, everything that uses GDAL
  mbtiles          one file, without sidecars: QGroundControl, ATAK, QGIS
  xyz              folder Z/X/Y.jpg with tiles.json: any web server
  mission-planner  folder that is copied into Mission Planner's gmapcache

Masks are not exported: where a tile shows no ground, other programs see the colours that fill it.

Exit codes: 0 exported; 1 the package was rejected, with findings and nothing written; 2 the job could
not be done; 130 interrupted.)";
}

std::string_view CacheExportCommand::examples() const {
  return R"(nadir cache export package --format pmtiles --trust root.json --out package.pmtiles
nadir cache export package --format mission-planner --trust root.json --out gmapcache)";
}

void CacheExportCommand::setup(Options& options) {
  options.positional("PACKAGE", package_, "package folder").required();
  options.value("--format", format_, "FORMAT", "of the output")
      .required()
      .one_of({"pmtiles", "gpkg", "mbtiles", "xyz", "mission-planner"});
  options.value("--trust", trust_, "ROOT.json", "root of trust that the package is verified with").required();
  options.value("--at", at_, "TIME", "evaluate validity as of this time instead of now");
  options.value("--out", out_, "OUT", "file or folder to create; must not exist").required();
}

int CacheExportCommand::run(Context& context) {
  const TrustRoot root = read_trusted_root(trust_);
  const ExportedTiles exported = export_tiles({.package = package_,
                                               .out = out_,
                                               .format = *parse_tile_export_format(format_),
                                               .root = &root,
                                               .at = at_ ? *at_ : context.clock.now()},
                                              context.progress);
  if (exported.findings.has_errors()) {
    if (!context.quiet) context.err << "rejected: nothing was written\n";
    return report_findings(context.out, context.json, exported.findings);
  }
  if (context.json) {
    return report_findings(context.out, true, exported.findings,
                           {{"out", out_.string()},
                            {"format", format_},
                            {"tiles", exported.tiles},
                            {"contents", exported.contents},
                            {"bytes", exported.bytes}});
  }
  if (!exported.findings.empty()) print_findings(context.out, exported.findings);
  Figures figures{{format_, out_.string()}, {"tiles", std::to_string(exported.tiles)}};
  if (exported.contents != exported.tiles) figures.emplace_back("different", std::to_string(exported.contents));
  figures.emplace_back("size", fmt::format("{:.1f} MB", static_cast<double>(exported.bytes) / 1e6));
  print_figures(context.out, figures);
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_cache_export() { return std::make_unique<CacheExportCommand>(); }

}  // namespace nadir
