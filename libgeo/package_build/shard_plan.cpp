#include "package_build/shard_plan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "base/json.hpp"
#include "package/mission_check.hpp"
#include "raster/pinned_files.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr const char* kSchema = "nadir.shard-plan/2";
constexpr std::uint64_t kMaxPlanBytes = std::uint64_t{1} << 30;
constexpr std::int64_t kMaxNumber = std::numeric_limits<std::int64_t>::max();

json json_of(const std::vector<PinnedFile>& files) {
  json result = json::array();
  for (const PinnedFile& file : files) {
    json one = {{"path", file.path.string()},
                {"bytes", file.bytes},
                {"modified_ns", file.modified_ns},
                {"sha256", file.sha256.hex()}};
    if (file.object) {
      one["block_bytes"] = file.object->block_bytes;
      one["block_sha256"] = blocks_text(*file.object);
    }
    result.push_back(std::move(one));
  }
  return result;
}

json json_of(const PinnedLayer& layer) { return {{"path", layer.path.string()}, {"files", json_of(layer.files)}}; }

json json_of(const ImageryInput& input, const std::vector<PinnedFile>& files) {
  json outline = json::array();
  for (const MercatorXY& point : input.outline) outline.push_back({point.x_m, point.y_m});
  json result = {{"path", input.path.string()},
                 {"captured", to_rfc3339(input.facts.captured_at)},
                 {"gsd_m", input.facts.gsd_m},
                 {"ce90_m", input.facts.ce90_m},
                 {"provider", input.facts.provider},
                 {"licence", input.facts.licence},
                 {"attribution", input.facts.attribution},
                 {"pixel_m", input.pixel_m},
                 {"outline", outline},
                 {"files", json_of(files)}};
  result["stretch"] = input.stretch ? json({input.stretch->low, input.stretch->high}) : json(nullptr);
  return result;
}

std::vector<PinnedFile> read_files(const JsonReader& in) {
  const JsonReader list = in.array("files", {.least = 1, .most = 1'000'000});
  std::vector<PinnedFile> files;
  for (std::size_t i = 0; i < list.size(); ++i) {
    const JsonReader file = list.object(i);
    files.push_back({file.text("path", {.least = 1, .most = 4096}), file.integer<std::uint64_t>("bytes", 0, kMaxNumber),
                     file.integer("modified_ns", std::numeric_limits<std::int64_t>::min(), kMaxNumber),
                     file.digest("sha256")});
    PinnedFile& pinned = files.back();
    if (const auto blocks = file.optional_text("block_sha256")) {
      const auto block_bytes = file.integer<std::uint64_t>("block_bytes", 1, kMaxNumber);
      auto digests = parse_blocks(*blocks, pinned.bytes, block_bytes);
      if (!digests) file.refuse("block_sha256", "a SHA-256 for each block of the object, in base64", "other text");
      pinned.object = std::make_shared<const ObjectPin>(ObjectPin{
          parse_object_address(pinned.path.string()), pinned.bytes, pinned.sha256, block_bytes, *std::move(digests)});
    }
    file.finish();
  }
  return files;
}

PinnedLayer read_layer(const JsonReader& in) { return {in.text("path", {.least = 1, .most = 4096}), read_files(in)}; }

ImageryInput read_input(const JsonReader& in) {
  ImageryInput input;
  input.path = in.text("path", {.least = 1, .most = 4096});
  input.facts = {in.time("captured"),
                 in.number("gsd_m", 1e-9, 1e9),
                 in.number("ce90_m", 1e-9, 1e9),
                 in.text("provider", {.least = 0, .most = 65536}),
                 in.text("licence", {.least = 0, .most = 65536}),
                 in.text("attribution", {.least = 0, .most = 65536})};
  input.pixel_m = in.number("pixel_m", 0, 1e9);
  const JsonReader outline = in.array("outline", {.least = 3, .most = 4096});
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const JsonReader point = outline.array(i, {.least = 2, .most = 2});
    input.outline.push_back({point.number(0, -1e9, 1e9), point.number(1, -1e9, 1e9)});
  }
  if (!in.is_null("stretch")) {
    const JsonReader stretch = in.array("stretch", {.least = 2, .most = 2});
    input.stretch = Stretch{stretch.number(0), stretch.number(1)};
    if (input.stretch->high <= input.stretch->low) in.refuse("stretch", "two rising values");
  } else {
    in.value("stretch");
  }
  return input;
}

TileSetOptions read_options(const JsonReader& in) {
  TileSetOptions options;
  constexpr std::array kContainers = {TileSetKind::mbtiles, TileSetKind::cog};
  const std::string_view container = in.choice("container", {file_of(kContainers[0]), file_of(kContainers[1])});
  options.container = container == file_of(TileSetKind::cog) ? TileSetKind::cog : TileSetKind::mbtiles;
  options.encoding.format = in.choice("format", std::array{ImageFormat::jpeg, ImageFormat::png, ImageFormat::webp});
  options.encoding.quality = in.integer<int>("quality", 1, 100);
  options.encoding.lossless = in.boolean("lossless");
  options.mosaic.feather_m = in.number("feather_m", 0, 1e6);
  in.finish();
  return options;
}

std::vector<MetatileSpan> read_shards(const JsonReader& in) {
  const JsonReader list = in.array("shards", {.least = 1, .most = kMaxShards});
  std::vector<MetatileSpan> shards;
  std::int64_t first = 0;
  for (std::size_t i = 0; i < list.size(); ++i) {
    const std::int64_t last = list.integer(i, first, kMaxNumber);
    shards.push_back({static_cast<std::size_t>(first), static_cast<std::size_t>(last)});
    first = last;
  }
  return shards;
}

}  // namespace

std::string ShardPlan::description() const {
  std::vector<Sha256> digests;
  for (const auto& files : pins) digests.push_back(digest_of(files));
  PackageRequest request;
  request.program = program;
  request.tiles = tiles;
  return describe_tiles(request, mission_text, inputs, digests) +
         fmt::format("plan: {} metatiles in {} shards\n", shards.back().last, shards.size());
}

std::string ShardPlan::description(int shard) const {
  const MetatileSpan part = shards.at(static_cast<std::size_t>(shard - 1));
  return description() +
         fmt::format("shard: {} of {}, metatiles {} to {}\n", shard, shards.size(), part.first, part.last);
}

std::string shard_plan_json(const ShardPlan& plan) {
  json imagery = json::array(), dem = json::array(), shards = json::array();
  for (std::size_t i = 0; i < plan.inputs.size(); ++i) imagery.push_back(json_of(plan.inputs[i], plan.pins[i]));
  for (const MetatileSpan& part : plan.shards) shards.push_back(part.last);
  for (const PinnedLayer& layer : plan.dem) dem.push_back(json_of(layer));
  json vectors;
  if (plan.vectors) {
    vectors = json_of(*plan.vectors);
    vectors["attribution"] = plan.vectors_origin.attribution;
    vectors["licence"] = plan.vectors_origin.licence;
  }
  const json document = {
      {"schema", kSchema},
      {"program", plan.program},
      {"mission_sha256", sha256(as_bytes(plan.mission_text)).hex()},
      {"imagery", imagery},
      {"tiles",
       {{"container", file_of(plan.tiles.container)},
        {"format", name_of(plan.tiles.encoding.format)},
        {"quality", plan.tiles.encoding.quality},
        {"lossless", plan.tiles.encoding.lossless},
        {"feather_m", plan.tiles.mosaic.feather_m}}},
      {"dem", dem},
      {"vectors", vectors},
      {"at", plan.at ? json(to_rfc3339(*plan.at)) : json(nullptr)},
      {"shards", shards},
  };
  return document.dump(1) + '\n';
}

ShardPlan parse_shard_plan(std::string_view text, std::string_view mission_text, const std::string& name) {
  const json document = parse_json(text, name);
  const JsonReader in(
      document,
      {.name = name, .what = "this plan of a build cannot be read", .fix = "make a new one: nadir cache plan-shards"});
  in.expect("schema", kSchema);
  ShardPlan plan;
  plan.program = in.text("program", {.least = 1, .most = 256});
  plan.mission_text = mission_text;
  if (in.digest("mission_sha256") != sha256(as_bytes(mission_text))) {
    in.refuse("mission_sha256", "the digest of mission.yaml beside it");
  }
  plan.mission = parse_mission_or_throw(mission_text, fs::path(name).parent_path() / kShardPlanMission);
  const JsonReader imagery = in.array("imagery", {.least = 1, .most = 1'000'000});
  for (std::size_t i = 0; i < imagery.size(); ++i) {
    const JsonReader input = imagery.object(i);
    plan.inputs.push_back(read_input(input));
    plan.pins.push_back(read_files(input));
    input.finish();
  }
  plan.tiles = read_options(in.object("tiles"));
  const JsonReader dem = in.array("dem", {.least = 0, .most = 1'000'000});
  for (std::size_t i = 0; i < dem.size(); ++i) {
    const JsonReader layer = dem.object(i);
    plan.dem.push_back(read_layer(layer));
    layer.finish();
  }
  if (in.is_null("vectors")) {
    in.value("vectors");
  } else {
    const JsonReader vectors = in.object("vectors");
    plan.vectors = read_layer(vectors);
    plan.vectors_origin = {vectors.text("attribution", {.least = 1, .most = 65536}),
                           vectors.text("licence", {.least = 1, .most = 65536})};
    vectors.finish();
  }
  if (in.is_null("at")) {
    in.value("at");
  } else {
    plan.at = in.time("at");
  }
  plan.shards = read_shards(in);
  in.finish();
  return plan;
}

ShardPlan read_shard_plan(const fs::path& folder, std::string_view program) {
  const fs::path file = folder / kShardPlanFile;
  if (!fs::is_regular_file(file)) {
    throw UsageError({.what = "this folder holds no plan of a build",
                      .where = folder.string(),
                      .expected = kShardPlanFile,
                      .fix = "make one: nadir cache plan-shards … --out " + folder.string()});
  }
  ShardPlan plan = parse_shard_plan(read_text_file(file, kMaxPlanBytes),
                                    read_text_file(folder / kShardPlanMission, std::uint64_t{1} << 20), file.string());
  if (plan.program != program) {
    throw UsageError({.what = "another version of nadir made this plan",
                      .where = file.string(),
                      .expected = plan.program,
                      .found = std::string(program),
                      .fix = "run the same version on all machines"});
  }
  return plan;
}

std::vector<MetatileSpan> split_metatiles(const TilePlan& plan, int shards) {
  const std::size_t count = plan.metatiles.size();
  std::vector<std::uint64_t> before{0};  // tiles before each metatile
  for (std::size_t i = 0; i < count; ++i) before.push_back(before.back() + plan.finest_tiles(i, i + 1));
  std::vector<MetatileSpan> result;
  std::size_t first = 0;
  for (int shard = 1; shard <= shards; ++shard) {
    const std::uint64_t wanted =
        before.back() / static_cast<std::uint64_t>(shards) * static_cast<std::uint64_t>(shard) +
        before.back() % static_cast<std::uint64_t>(shards) * static_cast<std::uint64_t>(shard) /
            static_cast<std::uint64_t>(shards);
    const auto end = std::lower_bound(before.begin() + static_cast<std::ptrdiff_t>(first), before.end(), wanted);
    const std::size_t last = shard == shards ? count : static_cast<std::size_t>(end - before.begin());
    result.push_back({first, last});
    first = last;
  }
  return result;
}

ShardPlanReport plan_shards(const PackageRequest& request, int shards, const fs::path& out, Progress& progress) {
  ShardPlanReport report;
  PreparedBuild build = prepare_build(request);
  report.findings = build.findings;
  report.findings.add(build.of_inputs);
  if (build.rejected()) return report;

  const TilePlan tiles(build.mission, build.inputs, build.range, request.tiles);
  if (static_cast<std::size_t>(shards) > tiles.metatiles.size()) {
    throw UsageError(
        {.what = "there is not enough work for so many shards",
         .where = "--shards",
         .expected = fmt::format("at most {}, the number of metatiles (8 x 8 tiles)", tiles.metatiles.size()),
         .found = std::to_string(shards)});
  }
  ShardPlan plan;
  plan.program = request.program;
  plan.mission_text = build.mission_text;
  plan.tiles = request.tiles;
  plan.at = request.at;
  plan.shards = split_metatiles(tiles, shards);

  StagingDirectory staging(out);
  progress.begin("hashing the inputs", build.inputs.size(), "rasters");
  for (ImageryInput& input : build.inputs) {
    plan.pins.push_back(pin_raster(input.path, input.stated_sha256));
    for (const PinnedFile& file : plan.pins.back()) report.imagery_bytes += file.bytes;
    if (mounted_object(input.path) == nullptr) input.path = fs::absolute(input.path);
    progress.advance();
  }
  plan.dem = pin_rasters(request.dem);
  if (request.vectors) {
    plan.vectors = PinnedLayer{fs::absolute(request.vectors->file), {pin_file(request.vectors->file)}};
    plan.vectors_origin = origin_of(*request.vectors);
  }
  plan.inputs = build.inputs;
  progress.end();
  write_file_atomic(staging.path() / kShardPlanMission, plan.mission_text);
  write_file_atomic(staging.path() / kShardPlanFile, shard_plan_json(plan));
  staging.commit();

  report.metatiles = tiles.metatiles.size();
  for (const ZoomCount& level : count_tiles(tiles.metatiles, build.range, build.mission.zoom.min)) {
    report.tiles += level.tiles;
  }
  for (const MetatileSpan& part : plan.shards) {
    report.most_tiles = std::max(report.most_tiles, tiles.finest_tiles(part.first, part.last));
  }
  return report;
}

}  // namespace nadir
