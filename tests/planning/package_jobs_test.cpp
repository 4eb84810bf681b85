#include "planning/package_jobs.hpp"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include <atomic>
#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "base/error.hpp"
#include "planning/child_program.hpp"
#include "planning/route_profile.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

ProgramCall shell(const std::string& script) { return {.words = {"/bin/sh", "-c", script}, .folder = "/"}; }

const auto kNever = [] { return false; };

TEST(ChildProgram, GivesItsOutputLinesAndCode) {
  std::vector<std::string> lines;
  ProgramCall call = shell("pwd; echo \"$GREETING\" >&2; printf last >&2; exit 7");
  call.environment = {{"GREETING", "hello"}};
  const ProgramResult result = run_program_call(
      call, [&](std::string_view line) { lines.emplace_back(line); }, kNever);
  EXPECT_EQ(result.exit_code, 7);
  EXPECT_EQ(result.out, "/\n");
  EXPECT_THAT(lines, ElementsAre("hello", "last"));
}

TEST(ChildProgram, IsAskedToEndAndOtherwiseEnds) {
  std::atomic<bool> ready = false;
  const auto on_line = [&](std::string_view) { ready = true; };
  const auto stopped = [&] { return ready.load(); };
  EXPECT_EQ(
      run_program_call(shell("trap 'exit 130' TERM; echo ready >&2; while :; do sleep 0.1; done"), on_line, stopped)
          .exit_code,
      130);
  EXPECT_EQ(run_program_call(
                shell("kill -9 $$"), [](std::string_view) {}, kNever)
                .exit_code,
            128 + 9);
}

TEST(ChildProgram, KeepsNoMoreThanItMay) {
  const ProgramResult result = run_program_call(
      shell("head -c 20000000 /dev/zero; head -c 300000 /dev/zero >&2"),
      [](std::string_view line) { EXPECT_LE(line.size(), 200'000U); }, kNever);
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_EQ(result.out.size(), kMaxProgramOutput);
  EXPECT_EQ(run_program_call(
                {.words = {"/no/such/program"}, .folder = "/"}, [](std::string_view) {}, kNever)
                .exit_code,
            127);
}

PackagePlan whole_plan() {
  PackagePlan plan;
  plan.steps = {PackageStep::build, PackageStep::sign};
  plan.mission = "missions/1/mission.yaml";
  plan.package = "packages/harbour-1";
  plan.report = "missions/1";
  plan.imagery = {"new map.tif", "old.tif"};
  plan.key = "planner.key.pem";
  plan.trust = "root.json";
  return plan;
}

TEST(PackageCommands, AreWhatAPersonWouldType) {
  const PackagePlan plan = whole_plan();
  EXPECT_EQ(
      shell_text(command_of(plan, PackageStep::build, {.interrupted_build = true})),
      "cache build --mission missions/1/mission.yaml --imagery 'new map.tif' --imagery old.tif --tile-format jpeg "
      "--quality 75 --format mbtiles --out packages/harbour-1 --resume --json");
  EXPECT_EQ(shell_text(command_of(plan, PackageStep::index, {})), "cache index packages/harbour-1 --json");
  EXPECT_THAT(shell_text(command_of(plan, PackageStep::index, {.is_signed = true})),
              HasSubstr("--key planner.key.pem"));
  EXPECT_EQ(shell_text({"it's", ""}), "'it'\\''s' ''");
}

// Any program stands for nadir here: what jobs do with its output and its exit code is what is tested.
class PackageJobsTest : public ::testing::Test {
 protected:
  fs::path program(const std::string& script) {
    const fs::path path = folder.write("program", "#!/bin/sh\n" + script + "\n");
    ::chmod(path.c_str(), 0755);
    fs::create_directories(folder / "missions/1");
    return path;
  }
  json finished(const PackageJobs& jobs) {
    while (jobs.busy("1")) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    return jobs.latest("1");
  }
  test::TemporaryFolder folder;
};

TEST_F(PackageJobsTest, RunsStepsAndReportsThem) {
  const fs::path nadir = program(
      "echo '{\"progress\":{\"label\":\"warping\",\"done\":3,\"total\":4,\"unit\":\"tiles\"}}' >&2; echo note >&2\n"
      "echo '{\"accepted\": true, \"findings\": [{\"code\": \"budget.exceeded\"}], \"tiles\": 4}'");
  {
    PackageJobs jobs(nadir, folder.path(), folder / "missions");
    EXPECT_TRUE(jobs.latest("1").is_null());
    EXPECT_TRUE(jobs.start("1", whole_plan()));
    const json report = finished(jobs);
    EXPECT_EQ(report["state"], "done") << report.dump(1);
    const json& step = report["steps"][0];
    EXPECT_EQ(step["label"], "warping");
    EXPECT_EQ(step["done"], 3);
    EXPECT_EQ(step["messages"], "note\n");
    EXPECT_EQ(step["result"]["tiles"], 4);
    EXPECT_EQ(step["findings"][0]["code"], "budget.exceeded");
  }
  PackageJobs again(nadir, folder.path(), folder / "missions");
  EXPECT_EQ(again.latest("1")["state"], "done") << "after a restart";
  EXPECT_TRUE(again.start("1", whole_plan()));
  EXPECT_EQ(finished(again)["number"], 2);
}

TEST_F(PackageJobsTest, ARejectionEndsTheJob) {
  PackageJobs jobs(program("echo '{\"findings\": []}'; exit 1"), folder.path(), folder / "missions");
  EXPECT_TRUE(jobs.start("1", whole_plan()));
  const json report = finished(jobs);
  EXPECT_EQ(report["state"], "rejected");
  EXPECT_EQ(report["steps"][1]["state"], "cancelled");
}

TEST_F(PackageJobsTest, WhatAnInterruptedBuildLeftForOtherInputsIsDiscarded) {
  fs::create_directories(folder / "packages/.harbour-1.staging");
  PackageJobs jobs(program("case \"$*\" in *--resume*) echo other inputs >&2; exit 2;; esac"), folder.path(),
                   folder / "missions");
  EXPECT_TRUE(jobs.start("1", whole_plan()));
  const json report = finished(jobs);
  EXPECT_EQ(report["state"], "done") << report.dump(1);
  EXPECT_EQ(report["steps"][0]["messages"], "other inputs\n");
}

TEST_F(PackageJobsTest, IsCancelledWhereverItIs) {
  PackageJobs jobs(program("trap 'exit 130' TERM; touch started; while :; do sleep 0.05; done"), folder.path(),
                   folder / "missions");
  fs::create_directories(folder / "missions/2");
  EXPECT_TRUE(jobs.start("1", whole_plan()));
  EXPECT_TRUE(jobs.start("2", whole_plan()));
  EXPECT_FALSE(jobs.start("1", whole_plan())) << "one at a time";
  EXPECT_TRUE(jobs.cancel("2")) << "while it waits";
  EXPECT_EQ(jobs.latest("2")["state"], "cancelled");
  while (!fs::exists(folder / "started")) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_TRUE(jobs.cancel("1"));
  EXPECT_EQ(finished(jobs)["state"], "cancelled");
  EXPECT_FALSE(jobs.cancel("1"));
}

TEST_F(PackageJobsTest, AJobThatAKilledDeskWasRunningSaysSo) {
  const fs::path nadir = program("true");
  folder.write("missions/1/job.json", R"({"number": 4, "state": "running", "steps": [
    {"kind": "build", "state": "running", "messages": ""}, {"kind": "sign", "state": "waiting", "messages": ""}]})");
  PackageJobs jobs(nadir, folder.path(), folder / "missions");
  const json report = jobs.latest("1");
  EXPECT_EQ(report["state"], "failed");
  EXPECT_THAT(report["steps"][0]["messages"].get<std::string>(), HasSubstr("the desk was stopped"));
  EXPECT_TRUE(jobs.start("1", whole_plan()));
  EXPECT_EQ(finished(jobs)["number"], 5);
}

TEST(RouteProfile, HeightsAreCountedFromWhatTheRouteSays) {
  Mission mission;
  mission.takeoff = {11.0, 48.0};
  mission.route.points = {{11.0, 48.0}, {11.02, 48.0}};
  mission.route.agl_m = 100;
  // The ground rises eastwards from 400 m by 10 m for each 0.01 degrees; beyond 11.015 nobody knows.
  const HeightOfGround ground = [](LonLat place) -> std::optional<double> {
    if (place.lon_deg > 11.015) return std::nullopt;
    return 400 + (place.lon_deg - 11) * 1000;
  };
  const auto near = [&](const RouteProfile& profile, double lon_deg) {
    return *std::min_element(profile.samples.begin(), profile.samples.end(), [&](const auto& a, const auto& b) {
      return std::abs(a.place.lon_deg - lon_deg) < std::abs(b.place.lon_deg - lon_deg);
    });
  };
  CameraModel camera;
  camera.width = 1000, camera.height = 500, camera.fx = camera.fy = 500;
  RouteProfile profile = profile_of(mission, ground, &camera, 200);
  EXPECT_NEAR(*near(profile, 11.01).height_m, 510, 0.1);
  EXPECT_EQ(near(profile, 11.01).agl_m, 100);
  EXPECT_EQ(near(profile, 11.01).width_m, 200);
  EXPECT_EQ(near(profile, 11.01).length_m, 100);
  EXPECT_FALSE(near(profile, 11.019).height_m);
  EXPECT_NEAR(profile.points_m.back(), 1491, 3);

  mission.route.height_frame = HeightFrame::above_takeoff;
  mission.route.heights_m = {50, 250};
  profile = profile_of(mission, ground, nullptr, 200);
  EXPECT_NEAR(*near(profile, 11.01).height_m, 550, 1);
  EXPECT_NEAR(*near(profile, 11.01).agl_m, 140, 1);
  mission.route.height_frame = HeightFrame::above_sea_level;
  EXPECT_NEAR(*near(profile_of(mission, ground, nullptr, 200), 11.01).agl_m, -260, 1) << "it would hit the ground";
  // From above take-off to above ground: the height above ground goes linearly, each over the ground of the place.
  mission.route.height_frame = HeightFrame::above_takeoff;
  mission.route.height_frames = {HeightFrame::above_takeoff, HeightFrame::above_ground};
  profile = profile_of(mission, ground, nullptr, 200);
  EXPECT_NEAR(*profile.samples.front().height_m, 450, 1);
  EXPECT_NEAR(*near(profile, 11.01).agl_m, 0.5 * (400 + 50 - 410) + 0.5 * 250, 1);
  mission.route.points.clear();
  mission.route.heights_m.clear();
  mission.route.height_frames.clear();
  EXPECT_TRUE(profile_of(mission, ground, nullptr, 200).samples.empty());
}

}  // namespace
}  // namespace nadir
