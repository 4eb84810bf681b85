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
#include "commands/cache/shard_options.hpp"
#include "commands/cache/tile_set_subject.hpp"
#include "commands/commands.hpp"
#include "package/package_writer.hpp"
#include "package/verify.hpp"
#include "package_build/matchability_survey.hpp"
#include "token_keys/token_key.hpp"

namespace nadir {
namespace {

class CacheMatchabilityCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "matchability"; }
  std::string_view summary() const override { return "map where frames can be matched to the map, and where not"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  void check_options() const;
  int make_shard(Context& context);
  MatchabilityResult survey(const TileSource& tiles, const Mission& mission, const std::optional<Manifest>& manifest,
                            Progress& progress);
  int put_into_package(Context& context);

  std::filesystem::path subject_;
  std::optional<std::filesystem::path> mission_;
  std::optional<std::filesystem::path> out_;
  bool into_package_ = false;
  std::optional<std::filesystem::path> key_;
  MatchabilityRequest request_;
  ShardOptions shards_{"nadir cache matchability", "matchability"};
};

std::string_view CacheMatchabilityCommand::details() const {
  return R"(At points across the mission's sectors and corridor, a piece of the map, altered as if seen in
another season by another sensor, is searched for in the surrounding map as a flight does. A place
is good where a single frame may match on its own, weak where a healthy prediction has to agree,
and poor where no match is to be expected: water, bare fields, repetitive rows. Reports the longest
route segments without a good place.

Where the package has vectors (`cache build --vectors`), areas of water are no ground to match with.

--out writes a GeoTIFF in EPSG:3857 with the bands ratio, entropy, texture, class, score and valid.
--into-package adds it to the package, as a file that is signed and verified like every other; a
package that does not match its manifest is rejected. The package changes in one step or not at
all.

Several machines may share a package's survey: each runs it with --shard I/N --shards FOLDER and the
same options, which writes the folder matchability-I-of-N; then one runs it with --shards FOLDER,
and gets the map that it would have made alone, byte for byte.

Exit codes: 0 success, 1 the package was rejected, 2 the job could not be done.)";
}

std::string_view CacheMatchabilityCommand::examples() const {
  return R"(nadir cache matchability package --camera camera.yaml --speed-mps 22 --out matchability.tif
nadir cache matchability package --camera camera.yaml --into-package --key planner.key.pem
nadir cache matchability package --camera camera.yaml --shards work --shard 3/8
nadir cache matchability others.mbtiles --mission mission.yaml --footprint-m 150 --step-m 50 --json)";
}

void CacheMatchabilityCommand::setup(Options& options) {
  options.positional("PACKAGE|FILE", subject_, "tile set: a package, MBTiles file or COG").required();
  options.value("--mission", mission_, "MISSION.yaml", "mission whose area is surveyed; a package contains its own");
  options.value("--out", out_, "FILE.tif", "write the map as a GeoTIFF");
  options.flag("--into-package", into_package_, "add the map to the package");
  options.value(
      "--key", key_, "KEY.pem",
      "with --into-package: private key (file or pkcs11: URI) of a package signer; required if the package is signed");
  request_.declare(options);
  shards_.setup(options);
}

void CacheMatchabilityCommand::check_options() const {
  shards_.check();
  if (shards_.make_one() && (out_ || into_package_)) {
    throw UsageError({.what = "--shard makes a part of the map",
                      .found = out_ ? "--out" : "--into-package",
                      .fix = "give it to the command that takes the shards: with --shards, without --shard"});
  }
  if (mission_ && (shards_.make_one() || shards_.take_all())) {
    throw UsageError({.what = "shards are made of a package and its own mission",
                      .found = "--mission",
                      .fix = "omit --mission, or --shards"});
  }
  if (key_ && !into_package_) {
    throw UsageError({.what = "--key requires --into-package", .fix = "give both, or omit --key"});
  }
  if (mission_ && into_package_) {
    throw UsageError({.what = "the map of another mission cannot be added to this package",
                      .where = subject_,
                      .found = "--mission and --into-package",
                      .fix = "omit --mission: the package contains its own"});
  }
}

// Reads the tiles that it needs, and hashes those; whoever takes the shards into a package hashes all of it.
int CacheMatchabilityCommand::make_shard(Context& context) {
  const Manifest manifest = load_package_manifest(subject_);
  const Mission mission = read_signed_mission(subject_, manifest);
  const std::optional<VectorLayer> vectors = read_package_vectors(subject_, manifest);
  const CheckedTileSet set = open_checked_tiles(subject_, manifest, context.progress);
  if (!set.tiles) return report_findings(context.out, context.json, set.findings);
  RequestedSurvey survey(*set.tiles, mission, vectors ? &*vectors : nullptr, request_);
  return shards_.make(survey.work(), manifest, *set.tiles, request_.thread_count(), context);
}

MatchabilityResult CacheMatchabilityCommand::survey(const TileSource& tiles, const Mission& mission,
                                                    const std::optional<Manifest>& manifest, Progress& progress) {
  if (shards_.take_all() && !manifest) {
    throw UsageError({.what = "shards are made of a package", .where = subject_, .found = "a tile set alone"});
  }
  std::optional<VectorLayer> vectors;
  if (manifest) vectors = read_package_vectors(subject_, *manifest);
  RequestedSurvey survey(tiles, mission, vectors ? &*vectors : nullptr, request_);
  shards_.finish(survey.work(), subject_, manifest.value_or(Manifest()), request_.thread_count(), progress);
  return survey.finish();
}

// Everything is hashed before the survey: what is signed anew has to be what was signed before.
int CacheMatchabilityCommand::put_into_package(Context& context) {
  const Manifest manifest = load_package_manifest(subject_);
  require_key_when_signed(subject_, key_.has_value());
  std::optional<PrivateKey> key;
  if (key_) key = read_signing_key(*key_);
  const Findings findings = check_before_signing(subject_, context.progress);
  if (findings.has_errors()) return report_findings(context.out, context.json, findings);
  const Mission mission = read_mission(subject_ / kMissionFile);
  const std::unique_ptr<TileSource> tiles = open_tile_source(find_tile_set(subject_).tiles);
  const MatchabilityResult result = survey(*tiles, mission, manifest, context.progress);
  const Amendment amendment{{kRoleMatchability}, [&](const std::filesystem::path& folder) {
                              std::filesystem::create_directories((folder / kMatchabilityFile).parent_path());
                              write_matchability_tiff(result.map, folder / kMatchabilityFile);
                              return std::vector{describe_file(folder, kMatchabilityFile, kRoleMatchability)};
                            }};
  const AmendedPackage amended =
      amend_package(subject_, manifest, mission, amendment, key ? &*key : nullptr, context.progress);
  if (amended.findings.has_errors()) {
    if (!context.quiet) context.err << "rejected: the package is unchanged\n";
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
  figures.emplace_back("signed by", key ? key->public_key().id() : "unsigned");
  print_figures(context.out, figures);
  return kAccepted;
}

int CacheMatchabilityCommand::run(Context& context) {
  check_options();
  if (shards_.make_one()) return make_shard(context);
  if (into_package_) return put_into_package(context);
  const auto [tiles, manifest, own_mission] = find_tile_set(subject_);
  if (!mission_ && own_mission.empty()) {
    throw UsageError({.what = "no mission that defines the area to survey",
                      .where = subject_.string(),
                      .expected = "--mission MISSION.yaml, or a package, which contains its mission"});
  }
  const Mission mission = read_mission(mission_.value_or(own_mission));
  const std::unique_ptr<TileSource> source = open_tile_source(tiles);
  const MatchabilityResult result = survey(*source, mission, manifest, context.progress);
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
