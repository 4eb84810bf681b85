// nadir cache matchability: where over the mission's ground will frames find their place on the map, and where not?
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>

#include "base/error.hpp"
#include "cli/command.hpp"
#include "cli/output.hpp"
#include "commands/cache/matchability_request.hpp"
#include "commands/cache/tile_set_subject.hpp"
#include "commands/commands.hpp"
#include "package/amend_package.hpp"
#include "package/sign_package.hpp"
#include "package_build/matchability_tiff.hpp"

namespace nadir {
namespace {

class CacheMatchabilityCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "matchability"; }
  std::string_view summary() const override { return "map where frames will find their place, and where not"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  void check_options() const;
  int put_into_package(Context& context);

  std::filesystem::path subject_;
  std::optional<std::filesystem::path> mission_;
  std::optional<std::filesystem::path> out_;
  bool into_package_ = false;
  std::optional<std::filesystem::path> key_;
  MatchabilityRequest request_;
};

std::string_view CacheMatchabilityCommand::details() const {
  return "For places all over the mission's sectors and corridor a piece of the map, worn as if another season and\n"
         "sensor had seen it, is searched in the map around it as a flight does. A place is good where a frame may\n"
         "anchor on its own, weak where a healthy prediction has to agree, poor where no anchor is to be expected:\n"
         "water, bare fields, endless rows. Says how far the route runs without a good place.\n\n"
         "--out writes a GeoTIFF in EPSG:3857 with the bands ratio, entropy, texture, class, score and valid.\n"
         "--into-package puts it into the package, as a file that is signed and verified like every other; a package\n"
         "that is not what its manifest says is refused (exit code 1). The package changes in one step or not at all.\n"
         "Exit code 0: made; 2: could not be made.";
}

std::string_view CacheMatchabilityCommand::examples() const {
  return "nadir cache matchability package --camera camera.yaml --cruise-mps 22 --out matchability.tif\n"
         "nadir cache matchability package --camera camera.yaml --into-package --key planner.key.pem\n"
         "nadir cache matchability others.mbtiles --mission mission.yaml --footprint-m 150 --step-m 50 --json";
}

void CacheMatchabilityCommand::setup(Options& options) {
  options.positional("PACKAGE|FILE", subject_, "the tile set: a package, MBTiles or COG").required();
  options.value("--mission", mission_, "MISSION.yaml", "whose ground is looked at; a package has its own");
  options.value("--out", out_, "FILE.tif", "write the map as a GeoTIFF");
  options.flag("--into-package", into_package_, "put the map into the package");
  options.value("--key", key_, "KEY.pem", "with --into-package: private key of a package signer, if it is signed");
  request_.declare(options);
}

void CacheMatchabilityCommand::check_options() const {
  if (key_ && !into_package_) {
    throw UsageError({.what = "--key is for --into-package", .fix = "give both, or leave --key away"});
  }
  if (mission_ && into_package_) {
    throw UsageError({.what = "the map of another mission does not belong into this package",
                      .where = subject_,
                      .found = "--mission and --into-package",
                      .fix = "leave --mission away: the package has its own"});
  }
}

// Everything is hashed before the survey: what is signed anew has to be what was signed before.
int CacheMatchabilityCommand::put_into_package(Context& context) {
  const Manifest manifest = read_package_manifest(subject_);
  require_key_when_signed(subject_, key_.has_value());
  std::optional<PrivateKey> key;
  if (key_) key = PrivateKey::read(*key_);
  const Findings findings = check_before_signing(subject_, context.progress);
  if (findings.refuses()) return report_findings(context.out, context.json, findings);
  const Mission mission = read_mission(subject_ / kMissionFile);
  const MatchabilityResult result =
      make_matchability(find_tile_set(subject_).tiles, mission, request_, context.progress);
  const Amendment amendment{{kRoleMatchability}, [&](const std::filesystem::path& folder) {
                              std::filesystem::create_directories((folder / kMatchabilityFile).parent_path());
                              write_matchability_tiff(result.map, folder / kMatchabilityFile);
                              return std::vector{describe_file(folder, kMatchabilityFile, kRoleMatchability)};
                            }};
  const AmendedPackage amended =
      amend_package(subject_, manifest, mission, amendment, key ? &*key : nullptr, context.progress);
  if (amended.findings.refuses()) {
    if (!context.quiet) context.err << "refused: the package stays as it was\n";
    return report_findings(context.out, context.json, amended.findings);
  }
  if (out_) write_matchability_tiff(result.map, *out_);
  if (context.json) {
    nlohmann::json document = json_of(result);
    document.update({{"package", subject_.string()}, {"bytes", amended.added_bytes}, {"signed", amended.is_signed}});
    print_json(context.out, document);
    return kAccepted;
  }
  Figures figures = figures_of(result);
  figures.emplace_back("in the package", fmt::format("{}, {} bytes", kMatchabilityFile, amended.added_bytes));
  figures.emplace_back("signed by", key ? key->public_key().id() : "nobody");
  print_figures(context.out, figures);
  return kAccepted;
}

int CacheMatchabilityCommand::run(Context& context) {
  check_options();
  if (into_package_) return put_into_package(context);
  const auto [tiles, manifest, own_mission] = find_tile_set(subject_);
  if (!mission_ && own_mission.empty()) {
    throw UsageError({.what = "no mission that says which ground is looked at",
                      .where = subject_.string(),
                      .expected = "--mission MISSION.yaml, or a package, which has its mission inside"});
  }
  const Mission mission = read_mission(mission_.value_or(own_mission));
  const MatchabilityResult result = make_matchability(tiles, mission, request_, context.progress);
  if (out_) write_matchability_tiff(result.map, *out_);
  if (context.json) {
    print_json(context.out, json_of(result));
  } else {
    print_figures(context.out, figures_of(result));
  }
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_cache_matchability() { return std::make_unique<CacheMatchabilityCommand>(); }

}  // namespace nadir
