// From a mission to its package, step by step: each step is a command of `nadir`, run as a program of its own.
//
// So what a desk makes is what the command line makes, to the byte; the command can be shown, and repeated by hand; a
// step that fails or is cancelled takes nothing else with it; and no key is ever read by the desk. Jobs run one after
// the other. A job's report is kept beside its mission; one that was running when the desk was stopped says so, and the
// build continues where it was when it is started again.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "base/time.hpp"

namespace nadir {

enum class PackageStep { estimate, build, index, matchability, sign, verify, predict };
std::string_view name_of(PackageStep step);
std::optional<PackageStep> package_step_of(std::string_view name);

// All paths absolute, or relative to the folder in which commands run.
struct PackagePlan {
  std::vector<PackageStep> steps;
  std::filesystem::path mission;  // mission.yaml
  std::filesystem::path package;  // folder
  std::filesystem::path report;   // folder for what steps write besides: prediction.geojson
  std::vector<std::filesystem::path> imagery;
  std::optional<std::filesystem::path> elevation, camera, key, trust, vectors;
  std::optional<std::string> vectors_attribution, vectors_licence;  // where they do not state their own
  std::string tile_format = "jpeg";
  int quality = 75;
  std::string container = "mbtiles";
  std::optional<UtcTime> at;  // of evaluation, instead of the present
};

// What is there when a step begins: an interrupted build has left its work; the package is signed, so that a step that
// changes it must sign it again.
struct PackageNow {
  bool interrupted_build = false;
  bool is_signed = false;
};

// The arguments of the program.
std::vector<std::string> command_of(const PackagePlan& plan, PackageStep step, const PackageNow& now);

// As a shell takes it.
std::string shell_text(const std::vector<std::string>& words);

enum class JobState { waiting, running, done, rejected, failed, cancelled };
std::string_view name_of(JobState state);

class PackageJobs {
 public:
  // program: nadir itself. folder: where its commands run. reports: a mission's job.json lies in reports/ID.
  PackageJobs(std::filesystem::path program, std::filesystem::path folder, std::filesystem::path reports);
  ~PackageJobs();  // a step that runs is asked to end
  PackageJobs(const PackageJobs&) = delete;
  PackageJobs& operator=(const PackageJobs&) = delete;

  // false: the mission has one that is not finished.
  bool start(const std::string& mission, PackagePlan plan);
  bool busy(std::string_view mission) const;
  bool cancel(std::string_view mission);  // false: nothing to cancel

  // {number, state, steps: [{kind, state, command, label, done, total, unit, seconds, findings, result, messages}]}, or
  // null when there was none.
  nlohmann::json latest(std::string_view mission) const;

 private:
  struct Job;
  void run(const std::stop_token& stop);
  void run_step(Job& job, std::size_t index, const std::stop_token& stop);
  void keep(const Job& job) const;  // job.json; `mutex_` held
  std::filesystem::path report_file(std::string_view mission) const;

  const std::filesystem::path program_, folder_, reports_;
  mutable std::mutex mutex_;
  std::condition_variable_any news_;
  std::map<std::string, std::shared_ptr<Job>, std::less<>> jobs_;  // the latest of each mission
  std::deque<std::shared_ptr<Job>> waiting_;
  std::jthread worker_;
};

}  // namespace nadir
