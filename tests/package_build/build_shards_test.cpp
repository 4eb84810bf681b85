// A build by several machines against the build by one: the same bytes, whatever the number of shards and whatever
// happens to them.
#include "package_build/build_shards.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "package_build/build_journal.hpp"
#include "package_build/package_builder_fixture.hpp"
#include "support/small_disk.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// 300 m of the field at zoom 21: a dozen metatiles, and three zooms of overviews above them.
class BuildShards : public test::PackageBuilder {
 protected:
  BuildShards() {
    spec_.width = spec_.height = 1000;
    (*spec_.transform)[0] += 90, (*spec_.transform)[3] -= 90;
    spec_.nodata = 0;
    hole_ = [](int column, int row) { return column < 30 || row > 980; };  // masks take part
    write_map("map.tif");
    write_mission_of_zooms();
  }

  void write_mission_of_zooms(int budget_mb = 50) {
    write_mission(400, budget_mb);
    std::string text = read_text_file(folder_ / "mission.yaml");
    text.replace(text.find("min: 14, max: 19"), 16, "min: 15, max: 21");
    folder_.write("mission.yaml", text);
  }

  PackageRequest wanted(const std::string& out) {
    PackageRequest request = PackageBuilder::request(out);
    request.program = "test";
    return request;
  }

  ShardPlanReport plan(int shards, const std::string& out, TileSetKind container = TileSetKind::mbtiles) {
    PackageRequest request = wanted("unused");
    request.key = nullptr;
    request.tiles.container = container;
    return plan_shards(request, shards, folder_ / out, progress_);
  }

  ShardRequest shard_request(const std::string& plan, const std::string& shard) {
    ShardRequest request;
    request.plan = folder_ / plan;
    request.shard = shard;
    request.threads = 2;
    request.program = "test";
    request.on_remark = [this](std::string_view remark) { remarks_.emplace_back(remark); };
    return request;
  }
  ShardReport shard(const std::string& plan, const std::string& shard) {
    return build_shard(shard_request(plan, shard), progress_);
  }
  void all_shards(const std::string& of_plan, int shards) {
    for (int i = shards; i >= 1; --i) {  // in any order
      const ShardReport report = shard(of_plan, fmt::format("{}/{}", i, shards));
      ASSERT_FALSE(report.findings.has_errors());
      EXPECT_FALSE(report.was_there);
    }
  }

  MergeRequest merge_request(const std::string& plan, const std::string& out) {
    MergeRequest request;
    request.plan_folder = folder_ / plan;
    request.plan = read_shard_plan(request.plan_folder, "test");
    request.key = &key_;
    request.out = folder_ / out;
    return request;
  }
  PackageReport merge(const std::string& plan, const std::string& out) {
    return merge_shards(merge_request(plan, out), progress_);
  }

  // The text of the error that it throws.
  static ErrorText error_of(const std::function<void()>& action) {
    try {
      action();
    } catch (const Error& error) {
      return error.text();
    }
    ADD_FAILURE() << "no error";
    return {};
  }

  test::ProcessResult killed(std::initializer_list<std::string> args, int event) {
    std::vector<std::string> all{NADIR_KILLED_SHARD};
    all.insert(all.end(), args);
    all.push_back(std::to_string(event));
    return test::run_process(all);
  }

  NoProgress progress_;
  std::vector<std::string> remarks_;
};

TEST_F(BuildShards, TheMergedPackageIsThatOfOneMachineWhateverTheirNumber) {
  ASSERT_FALSE(build(wanted("map.whole")).findings.has_errors());
  for (const int shards : {1, 2, 3, 8}) {
    const std::string name = fmt::format("map.plan{}", shards), package = fmt::format("map.package{}", shards);
    const ShardPlanReport report = plan(shards, name);
    ASSERT_FALSE(report.findings.has_errors());
    EXPECT_GE(report.metatiles, 9U);
    all_shards(name, shards);
    ASSERT_FALSE(merge(name, package).findings.has_errors());
    expect_same_files(folder_ / "map.whole", folder_ / package);
  }
}

TEST_F(BuildShards, ACogAsWellWithSeamsAndSeveralRasters) {
  // A second raster lies over the seam between two shards and fades into the first.
  test::RasterSpec upper = spec_;
  upper.width = 500;
  (*upper.transform)[0] += 40;
  test::write_raster(folder_ / "map.upper.tif", upper, [](int column, int row) -> std::array<int, 4> {
    return {column % 200 + 20, row % 200 + 20, 90, 255};
  });
  test::write_item(folder_ / "map.upper.tif");
  PackageRequest request = wanted("map.whole");
  request.imagery = {folder_ / "map.upper.tif", folder_ / "map.tif"};
  request.tiles.container = TileSetKind::cog;
  request.tiles.mosaic.feather_m = 8;
  ASSERT_FALSE(build(request).findings.has_errors());
  request.key = nullptr;
  ASSERT_FALSE(plan_shards(request, 3, folder_ / "map.plan", progress_).findings.has_errors());
  all_shards("map.plan", 3);
  ASSERT_FALSE(merge("map.plan", "map.merged").findings.has_errors());
  expect_same_files(folder_ / "map.whole", folder_ / "map.merged");
}

TEST_F(BuildShards, EachTileIsMadeOnceAndTheSharesAreEven) {
  const ShardPlanReport report = plan(4, "map.plan");
  const ShardPlan parsed = read_shard_plan(folder_ / "map.plan", "test");
  ASSERT_EQ(parsed.shards.size(), 4U);
  std::size_t next = 0;
  for (const MetatileSpan& part : parsed.shards) {
    EXPECT_EQ(part.first, next);
    EXPECT_GT(part.count(), 0U);
    next = part.last;
  }
  EXPECT_EQ(next, report.metatiles);
  std::uint64_t tiles = 0, most = 0;
  const TilePlan whole(parsed.mission, parsed.inputs, plan_range(parsed.mission, parsed.inputs), parsed.tiles);
  for (const MetatileSpan& part : parsed.shards) {
    tiles += whole.finest_tiles(part.first, part.last);
    most = std::max(most, whole.finest_tiles(part.first, part.last));
  }
  EXPECT_EQ(tiles, whole.finest_tiles(0, whole.metatiles.size()));
  EXPECT_EQ(most, report.most_tiles);
  EXPECT_LE(most, tiles / 4 + 64);  // no more than a metatile over its share
  EXPECT_THAT(error_of([&] { plan(1000, "map.many"); }).expected, HasSubstr("metatiles"));
  EXPECT_FALSE(fs::exists(folder_ / "map.many"));
}

TEST_F(BuildShards, AShardThatIsThereIsCheckedAndLeftAsItIs) {
  plan(2, "map.plan");
  const ShardReport made = shard("map.plan", "2/2");
  const fs::path file = made.folder / kJournalFile;
  const Bytes before = read_file(file);
  const auto time = fs::last_write_time(file);
  const ShardReport again = shard("map.plan", "2/2");
  EXPECT_TRUE(again.was_there);
  EXPECT_EQ(again.tiles, made.tiles);
  EXPECT_EQ(again.metatiles, made.metatiles);
  EXPECT_EQ(again.bytes, made.bytes);
  EXPECT_EQ(fs::last_write_time(file), time);
  EXPECT_EQ(read_file(file), before);

  // Damaged, cut, or with something behind it: an error that names it, from the shard and from the merge.
  ASSERT_FALSE(shard("map.plan", "1/2").findings.has_errors());
  const std::vector<std::function<void(Bytes&)>> damages = {[](Bytes& bytes) { bytes[bytes.size() / 2] ^= 1; },
                                                            [](Bytes& bytes) { bytes.resize(bytes.size() - 1); },
                                                            [](Bytes& bytes) { bytes.push_back(0); }};
  for (const auto& damage : damages) {
    Bytes bytes = before;
    damage(bytes);
    write_file_atomic(file, bytes);
    EXPECT_THAT(error_of([&] { shard("map.plan", "2/2"); }).where, HasSubstr("shard-2-of-2"));
    EXPECT_THAT(error_of([&] { merge("map.plan", "package"); }).where, HasSubstr("shard-2-of-2"));
  }
  // So is one whole metatile too few.
  write_file_atomic(file, before);
  {
    JournalReader records(file);
    fs::remove(folder_ / "map.short");
    BuildJournal shorter(folder_ / "map.short", records.configuration());
    ASSERT_FALSE(shorter.next());
    for (std::uint64_t i = 1; i < made.metatiles; ++i) shorter.add(records.next().value());
  }
  fs::rename(folder_ / "map.short", file);
  EXPECT_EQ(error_of([&] { merge("map.plan", "package"); }).found, std::to_string(made.metatiles - 1));
  EXPECT_THAT(left_behind(), testing::IsEmpty());
}

TEST_F(BuildShards, AWrongSetOfShardsIsRefused) {
  plan(3, "map.plan");
  ASSERT_FALSE(shard("map.plan", "2/3").findings.has_errors());
  const ErrorText missing = error_of([&] { merge("map.plan", "package"); });
  EXPECT_EQ(missing.what, "shards are missing");
  EXPECT_THAT(missing.found, HasSubstr("1, 3"));
  EXPECT_THAT(missing.fix, HasSubstr("--shard 1/3"));
  ASSERT_FALSE(shard("map.plan", "1/3").findings.has_errors());
  ASSERT_FALSE(shard("map.plan", "3/3").findings.has_errors());

  // Twice, in two folders.
  fs::create_directory(folder_ / "map.node2");
  fs::copy(folder_ / "map.plan" / "shard-3-of-3", folder_ / "map.node2" / "shard-3-of-3", fs::copy_options::recursive);
  MergeRequest request = merge_request("map.plan", "package");
  request.folders = {folder_ / "map.plan", folder_ / "map.node2"};
  const ErrorText twice = error_of([&] { merge_shards(request, progress_); });
  EXPECT_EQ(twice.what, "a shard is there twice");
  EXPECT_THAT(twice.where, HasSubstr("3/3"));
  // The same folder named twice, and shards spread over folders, are fine.
  fs::remove_all(folder_ / "map.plan" / "shard-3-of-3");
  request.folders = {folder_ / "map.plan", folder_ / "map.node2", folder_ / "map.plan"};
  request.out = folder_ / "map.spread";
  EXPECT_FALSE(merge_shards(request, progress_).findings.has_errors());

  // One under another's name.
  fs::copy(folder_ / "map.plan" / "shard-2-of-3", folder_ / "map.plan" / "shard-3-of-3", fs::copy_options::recursive);
  const ErrorText renamed = error_of([&] { merge("map.plan", "package"); });
  EXPECT_THAT(renamed.expected, HasSubstr("shard: 3 of 3"));
  EXPECT_THAT(renamed.found, HasSubstr("shard: 2 of 3"));
  EXPECT_THAT(error_of([&] { shard("map.plan", "3/3"); }).found, HasSubstr("shard: 2 of 3"));

  // From another number of shards, another mission, other imagery, other options.
  const auto foreign = [&](const std::string& name) {
    EXPECT_FALSE(shard(name, "3/3").findings.has_errors()) << name;
    fs::remove_all(folder_ / "map.plan" / "shard-3-of-3");
    fs::rename(folder_ / name / "shard-3-of-3", folder_ / "map.plan" / "shard-3-of-3");
    return error_of([&] { merge("map.plan", "package"); });
  };
  PackageRequest options = wanted("unused");
  options.key = nullptr;
  options.tiles.encoding.quality = 60;
  plan_shards(options, 3, folder_ / "map.quality", progress_);
  EXPECT_THAT(foreign("map.quality").found, HasSubstr("quality 60"));
  write_map("map.tif", {200, 180, 140});
  plan(3, "map.imagery");
  EXPECT_THAT(foreign("map.imagery").found, HasSubstr("imagery 1: sha256"));
  std::string text = read_text_file(folder_ / "mission.yaml");
  text.replace(text.find("sequence: 1"), 11, "sequence: 2");
  folder_.write("mission.yaml", text);
  plan(3, "map.mission");
  EXPECT_THAT(foreign("map.mission").found, HasSubstr("mission: sha256"));
  EXPECT_THAT(left_behind(), testing::IsEmpty());
}

TEST_F(BuildShards, ImageryThatChangesAfterThePlanIsNoticed) {
  plan(2, "map.plan");
  // Touched, as a copy on another machine: the digest decides.
  fs::last_write_time(folder_ / "map.tif", fs::last_write_time(folder_ / "map.tif") + std::chrono::hours(1));
  EXPECT_FALSE(shard("map.plan", "1/2").findings.has_errors());
  Bytes bytes = read_file(folder_ / "map.tif");
  bytes[bytes.size() / 2] ^= 1;
  write_file_atomic(folder_ / "map.tif", bytes);
  const ErrorText changed = error_of([&] { shard("map.plan", "2/2"); });
  EXPECT_EQ(changed.what, "an input has changed since the plan was made");
  EXPECT_THAT(changed.where, HasSubstr("map.tif"));
  fs::remove(folder_ / "map.tif");
  EXPECT_THAT(error_of([&] { shard("map.plan", "2/2"); }).fix, HasSubstr("same path"));
}

// A tile that was missing is no ground in the plan, and has no digest there.
TEST_F(BuildShards, ATileThatComesAfterThePlanIsNoticed) {
  for (const auto& [name, first] : {std::pair{"0.tif", 0}, std::pair{"1.tif", 500}}) {
    test::RasterSpec half = spec_;
    half.width = 500;
    (*half.transform)[0] += first * 0.3;
    test::write_raster(folder_ / name, half, [](int, int) -> std::array<int, 4> { return {90, 80, 70, 255}; });
  }
  const std::array<double, 6> at = spec_.transform.value();
  folder_.write(
      "tiles.json",
      fmt::format(
          R"({{"type": "Feature", "properties": {{"datetime": "2024-10-01T00:00:00Z", "gsd": 0.3, "nadir:ce90_m": 3,
      "license": "unknown", "providers": [{{"name": "x"}}], "tiles:tile_matrix_sets": {{"one": {{"supportedCRS":
      "http://www.opengis.net/def/crs/EPSG/0/32651", "tileMatrix": [{{"identifier": "0", "scaleDenominator": {},
      "topLeftCorner": [{}, {}], "tileWidth": 500, "tileHeight": {}, "matrixWidth": 2, "matrixHeight": 1}}]}}}}}},
      "asset_templates": {{"map": {{"href": "{{TileCol}}.tif"}}}}}})",
          at[1] / 0.28e-3, at[0], at[3], spec_.height));
  fs::rename(folder_ / "1.tif", folder_ / "later.tif");
  PackageRequest request = wanted("unused");
  request.key = nullptr;
  request.imagery = {folder_ / "tiles.json"};
  plan_shards(request, 1, folder_ / "tiles.plan", progress_);
  fs::rename(folder_ / "later.tif", folder_ / "1.tif");
  const ErrorText changed = error_of([&] { shard("tiles.plan", "1/1"); });
  EXPECT_EQ(changed.what, "an input has changed since the plan was made");
  EXPECT_EQ(changed.expected, "2 files");
  EXPECT_EQ(changed.found, "3 files");
}

TEST_F(BuildShards, AShardReadsOnlyWhatLiesThere) {
  // Two halves of the map; a shard of the west does not need the file of the east.
  for (const auto& [name, first] : {std::pair{"map.west.tif", 0}, std::pair{"map.east.tif", 500}}) {
    test::RasterSpec half = spec_;
    half.width = 500;
    (*half.transform)[0] += first * 0.3;
    test::write_raster(folder_ / name, half, [first = first](int column, int row) -> std::array<int, 4> {
      return {(column + first) % 200 + 20, row % 200 + 20, 90, 255};
    });
    test::write_item(folder_ / name);
  }
  PackageRequest request = wanted("map.whole");
  request.imagery = {folder_ / "map.west.tif", folder_ / "map.east.tif"};
  ASSERT_FALSE(build(request).findings.has_errors());
  request.key = nullptr;
  const int shards = static_cast<int>(plan_shards(request, 1, folder_ / "map.probe", progress_).metatiles);
  plan_shards(request, shards, folder_ / "map.plan", progress_);
  fs::rename(folder_ / "map.east.tif", folder_ / "map.away.tif");
  int built = 0;
  for (int i = 1; i <= shards; ++i) {
    try {
      built += shard("map.plan", std::to_string(i)).was_there ? 0 : 1;
    } catch (const Error& error) {
      EXPECT_THAT(error.text().where, HasSubstr("map.east.tif"));
    }
  }
  EXPECT_GT(built, 0);
  EXPECT_LT(built, shards);
  fs::rename(folder_ / "map.away.tif", folder_ / "map.east.tif");
  for (int i = 1; i <= shards; ++i) shard("map.plan", std::to_string(i));
  ASSERT_FALSE(merge("map.plan", "map.merged").findings.has_errors());
  expect_same_files(folder_ / "map.whole", folder_ / "map.merged");
}

TEST_F(BuildShards, KilledAnywhereAShardContinues) {
  plan(2, "map.plan");
  ASSERT_FALSE(shard("map.plan", "1/2").findings.has_errors());
  ASSERT_FALSE(shard("map.plan", "2/2").findings.has_errors());
  const Bytes whole = read_file(folder_ / "map.plan" / "shard-2-of-2" / kJournalFile);
  const fs::path folder = folder_ / "map.plan" / "shard-2-of-2";
  fs::remove_all(folder);
  const auto counted = killed({folder_ / "map.plan", "2/2", "2"}, 0);
  ASSERT_EQ(counted.code, 0) << counted.err;
  const int events = std::stoi(counted.out);
  EXPECT_GT(events, 4);
  for (int event = 1; event <= events; ++event) {
    fs::remove_all(folder);
    const auto result = killed({folder_ / "map.plan", "2/2", "2"}, event);
    ASSERT_EQ(result.code, 128 + SIGKILL) << event << result.err;
    if (event == events) {  // after the last step: complete
      EXPECT_TRUE(fs::exists(folder));
    } else {
      EXPECT_FALSE(fs::exists(folder)) << event;
      remarks_.clear();
      const ShardReport report = shard("map.plan", "2/2");
      EXPECT_EQ(remarks_, std::vector<std::string>{"continuing a shard that was interrupted"});
      EXPECT_TRUE(event < events - 1 || report.resumed > 0) << event;
    }
    EXPECT_EQ(read_file(folder / kJournalFile), whole) << event;
  }
}

TEST_F(BuildShards, KilledAnywhereAMergeLeavesNoPackage) {
  ASSERT_FALSE(build(wanted("map.whole")).findings.has_errors());
  plan(2, "map.plan");
  all_shards("map.plan", 2);
  const std::string out = folder_ / "map.package";
  const auto counted = killed({folder_ / "map.plan", "merge", folder_ / "map.key.pem", folder_ / "map.first"}, 0);
  ASSERT_EQ(counted.code, 0) << counted.err;
  expect_same_files(folder_ / "map.whole", folder_ / "map.first");
  const int events = std::stoi(counted.out);
  for (int event = 1; event < events; event += 3) {
    const auto result = killed({folder_ / "map.plan", "merge", folder_ / "map.key.pem", out}, event);
    ASSERT_EQ(result.code, 128 + SIGKILL) << event << result.err;
    ASSERT_FALSE(fs::exists(out)) << event;
  }
  ASSERT_FALSE(merge("map.plan", "map.package").findings.has_errors());
  expect_same_files(folder_ / "map.whole", out);
}

// As a scheduler does that has lost the node on which it ended.
TEST_F(BuildShards, AMergeThatIsRepeatedFindsItsPackage) {
  plan(2, "map.plan");
  all_shards("map.plan", 2);
  EXPECT_FALSE(merge("map.plan", "map.package").was_there);
  const fs::path manifest = folder_ / "map.package" / kManifestFile;
  const auto time = fs::last_write_time(manifest);
  const PackageReport again = merge("map.plan", "map.package");
  EXPECT_TRUE(again.was_there);
  EXPECT_GT(again.tiles, 0U);
  EXPECT_EQ(fs::last_write_time(manifest), time);
  // A byte of it, a file more or less, or a package of something else: not replaced, and said.
  const auto refused = [&] { return error_of([&] { merge("map.plan", "map.package"); }); };
  const fs::path tiles = folder_ / "map.package" / kImageryFile;
  const Bytes good = read_file(tiles);
  Bytes bad = good;
  bad[bad.size() / 2] ^= 1;
  write_file_atomic(tiles, bad);
  EXPECT_EQ(refused().what, "there is a package already, and not the one of these shards");
  EXPECT_EQ(read_file(tiles), bad);
  write_file_atomic(tiles, good);
  folder_.write("map.package/more", "x");
  EXPECT_EQ(refused().found, "other files");
  fs::remove(folder_ / "map.package" / "more");
  fs::rename(folder_ / "map.package" / kSignatureFile, folder_ / "map.signature");
  EXPECT_EQ(refused().found, "other files");
  fs::rename(folder_ / "map.signature", folder_ / "map.package" / kSignatureFile);
  EXPECT_TRUE(merge("map.plan", "map.package").was_there);
  folder_.write("map.package/mission/mission.yaml", "id: other");
  EXPECT_EQ(refused().what, "the output exists already");
  EXPECT_THAT(left_behind(), testing::IsEmpty());
}

TEST_F(BuildShards, AFullDiskLosesNothing) {
  ASSERT_FALSE(build(wanted("map.whole")).findings.has_errors());
  plan(1, "map.plan");
  test::SmallDisk disk(folder_ / "map.small", "size=1200k");
  if (!disk.mounted()) GTEST_SKIP() << "NOT TESTED: a full disk needs root and a tmpfs to mount";
  ShardRequest request = shard_request("map.plan", "1/1");
  request.out = folder_ / "map.small";
  EXPECT_THAT(error_of([&] { build_shard(request, progress_); }).fix, HasSubstr("run the same command again"));
  EXPECT_FALSE(fs::exists(folder_ / "map.small" / "shard-1-of-1"));
  ASSERT_TRUE(disk.resize("64m"));
  EXPECT_GT(build_shard(request, progress_).resumed, 0U);

  // The merge, too: nothing of it stays, and the shard is as it was.
  test::SmallDisk full(folder_ / "map.full", "size=200k");
  ASSERT_TRUE(full.mounted());
  MergeRequest merging = merge_request("map.plan", "map.full/package");
  merging.folders = {folder_ / "map.small"};
  error_of([&] { merge_shards(merging, progress_); });
  EXPECT_TRUE(fs::is_empty(folder_ / "map.full"));
  ASSERT_TRUE(full.resize("64m"));
  ASSERT_FALSE(merge_shards(merging, progress_).findings.has_errors());
  expect_same_files(folder_ / "map.whole", folder_ / "map.full" / "package");
}

TEST_F(BuildShards, WhatABuildRefusesIsRefusedByPlanShardAndMerge) {
  // The plan: too old. Nothing is left.
  write_mission(30);
  EXPECT_TRUE(plan(2, "rejected").findings.contains("freshness.stale"));
  // The merge: a budget that only all shards together exceed; the shard: one that it exceeds alone.
  write_mission_of_zooms(1);
  ASSERT_FALSE(plan(4, "map.plan").findings.has_errors());
  all_shards("map.plan", 4);
  EXPECT_TRUE(merge("map.plan", "rejected").findings.contains("budget.exceeded"));
  ASSERT_FALSE(plan(1, "map.one").findings.has_errors());
  EXPECT_TRUE(shard("map.one", "1").findings.contains("budget.exceeded"));
  EXPECT_FALSE(fs::exists(folder_ / "map.one" / "shard-1-of-1"));
  // Another version of the program.
  ShardRequest other = shard_request("map.plan", "1/4");
  other.program = "0.2.0";
  EXPECT_THAT(error_of([&] { build_shard(other, progress_); }).fix, HasSubstr("same version"));
  EXPECT_THAT(left_behind(), testing::IsEmpty());
}

TEST_F(BuildShards, APlanThatWasEditedIsRefused) {
  plan(2, "map.plan");
  const std::string good = read_text_file(folder_ / "map.plan" / kShardPlanFile);
  const auto refused = [&](const std::function<void(nlohmann::json&)>& edit) {
    nlohmann::json document = nlohmann::json::parse(good);
    edit(document);
    write_file_atomic(folder_ / "map.plan" / kShardPlanFile, document.dump());
    return error_of([&] { shard("map.plan", "1/2"); }).where;
  };
  EXPECT_THAT(refused([](auto& plan) { plan["schema"] = "nadir.shard-plan/1"; }), HasSubstr("/schema"));
  EXPECT_THAT(refused([](auto& plan) { plan["shards"][1] = 1000; }), HasSubstr("plan.json"));
  EXPECT_THAT(refused([](auto& plan) { plan["shards"] = {5, 3}; }), HasSubstr("/shards/1"));
  EXPECT_THAT(refused([](auto& plan) { plan["tiles"]["quality"] = 0; }), HasSubstr("/tiles/quality"));
  EXPECT_THAT(refused([](auto& plan) { plan["imagery"][0]["outline"] = nlohmann::json::array(); }),
              HasSubstr("/imagery/0/outline"));
  EXPECT_THAT(refused([](auto& plan) { plan["more"] = 1; }), HasSubstr("plan.json"));
  write_file_atomic(folder_ / "map.plan" / kShardPlanFile, good);
  folder_.write("map.plan/mission.yaml", read_text_file(folder_ / "mission.yaml") + "\n");
  EXPECT_THAT(error_of([&] { shard("map.plan", "1/2"); }).where, HasSubstr("/mission_sha256"));
  // What is written is what is read.
  const std::string mission = read_text_file(folder_ / "mission.yaml");
  EXPECT_EQ(shard_plan_json(parse_shard_plan(good, mission, "plan.json")), good);
}

TEST(ShardNumber, ComesFromTheCommandLineOrFromTheScheduler) {
  std::map<std::string, std::string> environment;
  const EnvironmentVariable variable = [&](const char* name) {
    const auto found = environment.find(name);
    return found == environment.end() ? std::nullopt : std::optional(found->second);
  };
  const auto number = [&](std::string_view text) { return parse_shard(text, 8, variable); };
  EXPECT_EQ(number("3/8"), 3);
  EXPECT_EQ(number("8"), 8);
  for (const char* wrong : {"0/8", "9/8", "3/7", "3/", "/8", "", "x", "-1", "3/8/2", "1e0"}) {
    EXPECT_THROW(number(wrong), UsageError) << wrong;
  }
  EXPECT_THROW(number("auto"), UsageError);  // no scheduler

  environment = {{"SLURM_ARRAY_TASK_ID", "1"},
                 {"SLURM_ARRAY_TASK_MIN", "1"},
                 {"SLURM_ARRAY_TASK_MAX", "8"},
                 {"SLURM_ARRAY_TASK_COUNT", "8"}};
  EXPECT_EQ(number("auto"), 1);
  environment["SLURM_ARRAY_TASK_ID"] = "8";
  EXPECT_EQ(number("auto"), 8);
  // One task alone, run again: sbatch --array=3
  environment = {{"SLURM_ARRAY_TASK_ID", "3"},
                 {"SLURM_ARRAY_TASK_MIN", "3"},
                 {"SLURM_ARRAY_TASK_MAX", "3"},
                 {"SLURM_ARRAY_TASK_COUNT", "1"}};
  EXPECT_EQ(number("auto"), 3);
  // An array from 0 on is refused in every task, and so is one that is too long.
  environment = {{"SLURM_ARRAY_TASK_ID", "3"}, {"SLURM_ARRAY_TASK_MIN", "0"}, {"SLURM_ARRAY_TASK_MAX", "7"}};
  EXPECT_THROW(number("auto"), UsageError);
  environment = {{"SLURM_ARRAY_TASK_ID", "3"}, {"SLURM_ARRAY_TASK_MIN", "1"}, {"SLURM_ARRAY_TASK_MAX", "9"}};
  EXPECT_THROW(number("auto"), UsageError);

  for (const char* name : {"JOB_COMPLETION_INDEX", "AWS_BATCH_JOB_ARRAY_INDEX"}) {  // from 0 on
    environment = {{name, "0"}};
    EXPECT_EQ(number("auto"), 1) << name;
    environment = {{name, "7"}};
    EXPECT_EQ(number("auto"), 8) << name;
    for (const char* wrong : {"8", "-1", "", "two"}) {
      environment = {{name, wrong}};
      EXPECT_THROW(number("auto"), UsageError) << name << wrong;
    }
  }
  environment = {{"SLURM_ARRAY_TASK_ID", "1"}, {"JOB_COMPLETION_INDEX", "0"}};
  EXPECT_THROW(number("auto"), UsageError);
}

}  // namespace
}  // namespace nadir
