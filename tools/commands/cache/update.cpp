// `nadir cache update`: the next package of a series from the one before and newer imagery.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/cache/imagery_options.hpp"
#include "commands/commands.hpp"
#include "package_build/package_updater.hpp"
#include "token_keys/token_key.hpp"

namespace nadir {
namespace {

class CacheUpdateCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "update"; }
  std::string_view summary() const override { return "build the next package from an existing one and newer imagery"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path old_;
  std::filesystem::path trust_;
  std::filesystem::path mission_;
  std::vector<std::filesystem::path> imagery_;
  std::vector<std::string> stretches_;
  std::vector<std::filesystem::path> dem_;
  VectorOptions vectors_;
  int quality_ = 75;
  std::optional<std::string> format_;
  bool index_ = false;
  ImageryOptions options_{"newest"};
  std::optional<std::filesystem::path> key_;
  std::vector<std::filesystem::path> roots_;
  std::optional<UtcTime> at_;
  std::filesystem::path out_;
};

std::string_view CacheUpdateCommand::details() const {
  return R"(The old package is verified with --trust; it may have expired. Tiles without new imagery are copied
byte for byte, each checked against its signed digest, and keep their date and source. Tiles with
new imagery are decoded, merged above or below it (--mosaic) and encoded once, and so are the
overviews above them. Tiles that the mission no longer requires are dropped. The mission must have
the same series and zooms and a higher sequence.

The result is checked as a build's is: gaps, age, resolution, budget. On rejection the findings are
printed, the exit code is 1 and no output is left behind. The same inputs and the same key give the
same bytes.

The terrain is that of the old package unless --dem gives another, the vectors unless --vectors
does; newer roots of trust in it are
carried over. A place index belongs to the old tiles: --index rebuilds it with squares of the same
sizes. The container is that of the old package unless --format selects the other one; tiles are
copied either way.)";
}

std::string_view CacheUpdateCommand::examples() const {
  return R"(nadir cache update package --trust root.json --mission next.yaml --imagery spring.tif --key planner.key.pem --out package2
nadir cache update package --trust root.json --mission shorter.yaml --key planner.key.pem --out package2)";
}

void CacheUpdateCommand::setup(Options& options) {
  options.positional("OLD", old_, "package to update").required();
  options.value("--trust", trust_, "ROOT.json", "root of trust that the old package is verified with").required();
  options.value("--mission", mission_, "MISSION.yaml", "mission that the new map is for").required();
  options.values("--imagery", imagery_, "FILE", "newer rasters that GDAL reads; none if only the mission changes");
  options.values("--stretch", stretches_, "MIN,MAX",
                 "values of 16-bit or float imagery that become black and white, as for `cache build`");
  options.values("--dem", dem_, "FILE", "elevation models instead of the old package's terrain");
  vectors_.setup(options, "without it those of the old package stay as they are");
  options.value("--quality", quality_, "N", "quality of JPEG and WebP tiles that are re-encoded").between(1, 100);
  options.value("--format", format_, "FORMAT", "tile container, instead of the old package's")
      .one_of({"mbtiles", "cog"});
  options.flag("--index", index_, "rebuild the old package's place index for the new tiles");
  options_.setup(options);
  options.value("--key", key_, "KEY.pem",
                "private key (file or pkcs11: URI) that signs the package; without it the package is unsigned");
  options.values("--carry-root", roots_, "N.root.json", "newer root of trust to add to the package");
  options.value("--at", at_, "TIME", "evaluate ages as of this time instead of the mission's `created`");
  options.value("--out", out_, "NEW", "package folder to create; must not exist").required();
}

int CacheUpdateCommand::run(Context& context) {
  const TrustRoot trust = read_trusted_root(trust_);
  std::optional<PrivateKey> key;
  if (key_) key = read_signing_key(*key_);
  UpdateRequest request;
  request.old_package = old_;
  request.trust = &trust;
  request.mission = mission_;
  request.imagery = imagery_;
  request.overrides = options_.overrides();
  for (const std::string& text : stretches_) request.stretches.push_back(parse_stretch(text));
  request.dem = dem_;
  request.vectors = vectors_.request();
  request.tiles.encoding.quality = quality_;
  request.tiles.mosaic = options_.mosaic();
  request.tiles.threads = options_.threads();
  if (format_) request.container = *format_ == "cog" ? TileSetKind::cog : TileSetKind::mbtiles;
  request.index = index_;
  request.key = key ? &*key : nullptr;
  request.roots = roots_;
  request.at = at_;
  request.out = out_;
  if (!context.quiet)
    request.on_remark = [&context](std::string_view remark) { context.err << printable(remark) << '\n'; };

  const auto [report, counts, old_sequence, sequence] = update_package(request, context.progress);
  if (report.findings.has_errors()) {
    if (!context.quiet) context.err << "rejected: nothing was written\n";
    return report_findings(context.out, context.json, report.findings);
  }
  if (context.json) {
    return report_findings(context.out, true, report.findings,
                           {{"package", out_.string()},
                            {"from_sequence", old_sequence},
                            {"sequence", sequence},
                            {"tiles", report.tiles},
                            {"copied", counts.copied},
                            {"reencoded", counts.reencoded},
                            {"added", counts.added},
                            {"dropped", counts.dropped},
                            {"bytes", report.bytes},
                            {"signed", key.has_value()},
                            {"merkle_root", report.merkle_root.hex()}});
  }
  if (!report.findings.empty()) print_findings(context.out, report.findings);
  print_figures(context.out,
                {{"package", out_.string()},
                 {"sequence", fmt::format("{} -> {}", old_sequence, sequence)},
                 {"tiles", fmt::format("{} (zoom {} to {})", report.tiles, report.zoom.min, report.zoom.max)},
                 {"copied", std::to_string(counts.copied)},
                 {"re-encoded", std::to_string(counts.reencoded)},
                 {"added", std::to_string(counts.added)},
                 {"dropped", std::to_string(counts.dropped)},
                 {"vectors", report.vectors ? text_of(*report.vectors) : std::string("none")},
                 {"size", fmt::format("{:.1f} MB", static_cast<double>(report.bytes) / 1e6)},
                 {"merkle root", report.merkle_root.hex()},
                 {"signed by", key ? key->public_key().id() : "unsigned"}});
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_cache_update() { return std::make_unique<CacheUpdateCommand>(); }

}  // namespace nadir
