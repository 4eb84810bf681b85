#include "planning/package_jobs.hpp"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/json.hpp"
#include "base/printable.hpp"
#include "package/manifest.hpp"
#include "planning/child_program.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::array<std::pair<PackageStep, std::string_view>, 7> kStepNames{
    {{PackageStep::estimate, "estimate"},
     {PackageStep::build, "build"},
     {PackageStep::index, "index"},
     {PackageStep::matchability, "matchability"},
     {PackageStep::sign, "sign"},
     {PackageStep::verify, "verify"},
     {PackageStep::predict, "predict"}}};
constexpr std::size_t kMaxMessages = 8 * 1024;
constexpr std::uint64_t kMaxReport = std::uint64_t{64} << 20;
constexpr const char* kReportFile = "job.json";
constexpr int kExitRejected = 1, kExitFailed = 2, kExitInterrupted = 130;

bool plain_word(std::string_view word) {
  constexpr std::string_view kPlain = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-/=:,";
  return !word.empty() && word.find_first_not_of(kPlain) == std::string_view::npos;
}

// An option, where there is something to say.
void add(std::vector<std::string>& words, const char* option, const std::optional<fs::path>& value) {
  if (!value) return;
  words.emplace_back(option);
  words.push_back(value->string());
}

void add_tiles(std::vector<std::string>& words, const PackagePlan& plan) {
  for (const fs::path& raster : plan.imagery) add(words, "--imagery", raster);
  words.insert(words.end(), {"--tile-format", plan.tile_format, "--quality", std::to_string(plan.quality)});
}

fs::path staging_of(const fs::path& package) {
  return package.parent_path() / ("." + package.filename().string() + ".staging");
}

JobState state_after(PackageStep step, int exit_code, bool cancelled) {
  if (exit_code == 0) return JobState::done;
  if (cancelled || exit_code == kExitInterrupted) return JobState::cancelled;
  // A leg beyond the alert limit is a result, no failure.
  if (exit_code == kExitRejected) return step == PackageStep::predict ? JobState::done : JobState::rejected;
  return JobState::failed;
}

struct StepReport {
  PackageStep kind = PackageStep::build;
  JobState state = JobState::waiting;
  std::string command{};
  std::string label{}, unit{};  // of the progress
  std::uint64_t done = 0, total = 0;
  double seconds = 0;
  std::string result{};  // JSON as the command printed it, or nothing
  std::string messages{};
};

json step_json(const StepReport& step) {
  const json result = json::parse(step.result, nullptr, false);
  const bool readable = result.is_object();
  const bool has_findings = readable && result.contains("findings");
  return {{"kind", name_of(step.kind)},
          {"state", name_of(step.state)},
          {"command", step.command},
          {"label", step.label},
          {"done", step.done},
          {"total", step.total},
          {"unit", step.unit},
          {"seconds", step.seconds},
          {"findings", has_findings ? result["findings"] : json::array()},
          {"result", readable ? result : json()},
          {"messages", step.messages}};
}

// {"progress": {…}} as the program writes it; false: something else.
bool take_progress(std::string_view line, StepReport& step) {
  if (!line.starts_with("{\"progress\":")) return false;
  const json document = json::parse(line, nullptr, false);
  if (!document.is_object() || !document["progress"].is_object()) return false;
  const json& progress = document["progress"];
  step.label = progress.value("label", "");
  step.unit = progress.value("unit", "");
  step.done = progress.value("done", std::uint64_t{0});
  step.total = progress.value("total", std::uint64_t{0});
  return true;
}

}  // namespace

std::string_view name_of(PackageStep step) {
  for (const auto& [known, name] : kStepNames) {
    if (known == step) return name;
  }
  return "build";
}

std::optional<PackageStep> package_step_of(std::string_view name) {
  for (const auto& [step, known] : kStepNames) {
    if (known == name) return step;
  }
  return std::nullopt;
}

std::string_view name_of(JobState state) {
  switch (state) {
    case JobState::waiting: return "waiting";
    case JobState::running: return "running";
    case JobState::done: return "done";
    case JobState::rejected: return "rejected";
    case JobState::failed: return "failed";
    case JobState::cancelled: return "cancelled";
  }
  return "failed";
}

std::vector<std::string> command_of(const PackagePlan& plan, PackageStep step, const PackageNow& now) {
  const std::string mission = plan.mission.string(), package = plan.package.string();
  std::vector<std::string> words;
  switch (step) {
    case PackageStep::estimate:
      words = {"mission", "plan", mission};
      add_tiles(words, plan);
      break;
    case PackageStep::build:
      words = {"cache", "build", "--mission", mission};
      add_tiles(words, plan);
      add(words, "--dem", plan.elevation);
      add(words, "--vectors", plan.vectors);
      if (plan.vectors && plan.vectors_attribution)
        words.insert(words.end(), {"--vectors-attribution", *plan.vectors_attribution});
      if (plan.vectors && plan.vectors_licence) words.insert(words.end(), {"--vectors-licence", *plan.vectors_licence});
      words.insert(words.end(), {"--format", plan.container});
      add(words, "--out", plan.package);
      if (now.interrupted_build) words.emplace_back("--resume");
      break;
    case PackageStep::index:
      words = {"cache", "index", package};
      add(words, "--camera", plan.camera);
      if (now.is_signed) add(words, "--key", plan.key);
      break;
    case PackageStep::matchability:
      words = {"cache", "matchability", package, "--into-package"};
      add(words, "--camera", plan.camera);
      if (now.is_signed) add(words, "--key", plan.key);
      break;
    case PackageStep::sign:
      words = {"cache", "sign", package};
      add(words, "--key", plan.key);
      add(words, "--trust", plan.trust);
      break;
    case PackageStep::verify:
      words = {"cache", "verify", package};
      add(words, "--trust", plan.trust);
      words.insert(words.end(), {"--depth", "full"});
      break;
    case PackageStep::predict:
      words = {"mission", "predict", mission, package};
      add(words, "--camera", plan.camera);
      add(words, "--out", plan.report / "prediction.geojson");
      break;
  }
  const bool evaluates = step == PackageStep::build || step == PackageStep::verify || step == PackageStep::predict;
  if (plan.at && evaluates) words.insert(words.end(), {"--at", to_rfc3339(*plan.at)});
  words.emplace_back("--json");
  return words;
}

std::string shell_text(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) {
    if (!text.empty()) text += ' ';
    if (plain_word(word)) {
      text += word;
      continue;
    }
    text += '\'';
    for (const char c : word) text += c == '\'' ? "'\\''" : std::string(1, c);
    text += '\'';
  }
  return text;
}

struct PackageJobs::Job {
  std::string mission;
  PackagePlan plan;
  std::int64_t number = 1;
  JobState state = JobState::waiting;
  std::vector<StepReport> steps;
  bool cancelled = false;

  bool finished() const { return state != JobState::waiting && state != JobState::running; }
  json document() const {
    json list = json::array();
    for (const StepReport& step : steps) list.push_back(step_json(step));
    return {{"number", number}, {"state", name_of(state)}, {"steps", std::move(list)}};
  }
};

PackageJobs::PackageJobs(fs::path program, fs::path folder, fs::path reports)
    : program_(std::move(program)), folder_(std::move(folder)), reports_(std::move(reports)) {
  worker_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

PackageJobs::~PackageJobs() { worker_ = {}; }

fs::path PackageJobs::report_file(std::string_view mission) const { return reports_ / mission / kReportFile; }

bool PackageJobs::start(const std::string& mission, PackagePlan plan) {
  const json before = latest(mission);
  const std::lock_guard lock(mutex_);
  const auto known = jobs_.find(mission);
  if (known != jobs_.end() && !known->second->finished()) return false;
  auto job = std::make_shared<Job>();
  job->mission = mission;
  job->number = before.is_object() ? before.value("number", std::int64_t{0}) + 1 : 1;
  for (const PackageStep step : plan.steps) {
    std::vector<std::string> words = command_of(plan, step, {});
    words.insert(words.begin(), "nadir");
    job->steps.push_back({.kind = step, .command = shell_text(words)});
  }
  job->plan = std::move(plan);
  keep(*job);
  jobs_[mission] = job;
  waiting_.push_back(std::move(job));
  news_.notify_all();
  return true;
}

bool PackageJobs::busy(std::string_view mission) const {
  const std::lock_guard lock(mutex_);
  const auto known = jobs_.find(mission);
  return known != jobs_.end() && !known->second->finished();
}

bool PackageJobs::cancel(std::string_view mission) {
  const std::lock_guard lock(mutex_);
  const auto known = jobs_.find(mission);
  if (known == jobs_.end() || known->second->finished()) return false;
  const std::shared_ptr<Job> job = known->second;
  job->cancelled = true;
  if (job->state == JobState::waiting) {
    std::erase(waiting_, job);
    job->state = JobState::cancelled;
    keep(*job);
  }
  return true;
}

json PackageJobs::latest(std::string_view mission) const {
  const std::lock_guard lock(mutex_);
  if (const auto known = jobs_.find(mission); known != jobs_.end()) return known->second->document();
  std::error_code code;
  const fs::path file = report_file(mission);
  if (!fs::is_regular_file(file, code)) return {};
  json report = parse_json(read_text_file(file, kMaxReport), file.string(), {.max_depth = 32, .allow_floats = true});
  for (json& step : report["steps"]) {
    const bool interrupted = step.value("state", "") == name_of(JobState::running);
    if (interrupted) step["state"] = name_of(JobState::failed);
    if (interrupted) step["messages"] = "the desk was stopped while this ran; start it again: a build continues";
  }
  if (report["state"] == name_of(JobState::running) || report["state"] == name_of(JobState::waiting)) {
    report["state"] = name_of(JobState::failed);
  }
  return report;
}

void PackageJobs::keep(const Job& job) const {
  try {
    write_file_atomic(report_file(job.mission),
                      job.document().dump(-1, ' ', false, json::error_handler_t::replace) + "\n");
  } catch (const Error&) {
    return;  // the mission was deleted, or the disk is full: the job's own command says so
  }
}

void PackageJobs::run(const std::stop_token& stop) {
  for (;;) {
    std::shared_ptr<Job> job;
    {
      std::unique_lock lock(mutex_);
      if (!news_.wait(lock, stop, [&] { return !waiting_.empty(); })) return;
      job = std::move(waiting_.front());
      waiting_.pop_front();
      job->state = JobState::running;
    }
    for (std::size_t i = 0; i < job->steps.size(); ++i) {
      run_step(*job, i, stop);
      const std::lock_guard lock(mutex_);
      if (job->steps[i].state == JobState::done) continue;
      job->state = job->steps[i].state;
      for (std::size_t k = i + 1; k < job->steps.size(); ++k) job->steps[k].state = JobState::cancelled;
      break;
    }
    const std::lock_guard lock(mutex_);
    if (job->state == JobState::running) job->state = JobState::done;
    keep(*job);
  }
}

void PackageJobs::run_step(Job& job, std::size_t index, const std::stop_token& stop) {
  StepReport& step = job.steps[index];
  {
    const std::lock_guard lock(mutex_);
    step.state = JobState::running;
    keep(job);
  }
  const auto began = std::chrono::steady_clock::now();
  const auto elapsed_s = [&] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  };
  const auto on_line = [&](std::string_view line) {
    const std::lock_guard lock(mutex_);
    step.seconds = elapsed_s();
    if (take_progress(line, step)) return;
    step.messages += printable(line) + "\n";
    if (step.messages.size() > kMaxMessages) step.messages.erase(0, step.messages.size() - kMaxMessages);
  };
  const auto stopped = [&] {
    const std::lock_guard lock(mutex_);
    return job.cancelled || stop.stop_requested();
  };
  const auto run_once = [&](const PackageNow& now) {
    ProgramCall call{.words = command_of(job.plan, step.kind, now), .folder = folder_};
    call.words.insert(call.words.begin(), program_.string());
    call.environment = {{"NADIR_PROGRESS", "json"}};
    return run_program_call(call, on_line, stopped);
  };
  std::optional<ProgramResult> result;
  try {
    PackageNow now{.interrupted_build = fs::exists(folder_ / staging_of(job.plan.package)),
                   .is_signed = fs::exists(folder_ / job.plan.package / kSignatureFile)};
    if (!stopped()) result = run_once(now);
    // What an interrupted build left may belong to other inputs; then it is of no use.
    const bool useless = step.kind == PackageStep::build && now.interrupted_build;
    if (useless && result && result->exit_code == kExitFailed && !stopped()) result = run_once({});
  } catch (const Error& error) {
    on_line(error.what());
    result = ProgramResult{.exit_code = kExitFailed, .out = {}};
  }
  const bool cancelled = stopped();
  const std::lock_guard lock(mutex_);
  step.seconds = elapsed_s();
  step.state = result ? state_after(step.kind, result->exit_code, cancelled) : JobState::cancelled;
  if (result) step.result = std::move(result->out);
  keep(job);
}

}  // namespace nadir
