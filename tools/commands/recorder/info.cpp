// nadir recorder info: what is in a recording.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <ostream>

#include "base/printable.hpp"
#include "base/time.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "recorder/recording.hpp"

namespace nadir {
namespace {

struct SessionSum {
  const SessionRecord* about = nullptr;
  std::size_t segments = 0;
  std::uint64_t bytes = 0;
  std::map<Topic, std::uint64_t> records;
  std::optional<std::uint64_t> first_ns, last_ns;
  const EndRecord* end = nullptr;
};

SessionSum sum_of(const std::vector<SegmentContents>& segments, const std::string& id) {
  SessionSum sum;
  for (const SegmentContents& segment : segments) {
    if (!segment.session || segment.session->id != id) continue;
    if (sum.about == nullptr) sum.about = &*segment.session;
    ++sum.segments;
    sum.bytes += segment.segment.bytes;
    for (const auto& [topic, count] : segment.records) sum.records[topic] += count;
    const auto& mcap = segment.mcap;
    if (mcap.first_ns) sum.first_ns = std::min(sum.first_ns.value_or(*mcap.first_ns), *mcap.first_ns);
    if (mcap.last_ns) sum.last_ns = std::max(sum.last_ns.value_or(*mcap.last_ns), *mcap.last_ns);
    if (segment.segment.stream == Stream::flight) sum.end = segment.end ? &*segment.end : nullptr;
  }
  return sum;
}

bool clean(const SessionSum& sum) { return sum.end != nullptr && sum.end->clean_shutdown; }

std::string time_text(std::uint64_t at_ns) {
  return to_rfc3339(UtcTime{static_cast<std::int64_t>(at_ns / 1'000'000'000)});
}

double seconds(const SessionSum& sum) {
  if (!sum.first_ns || !sum.last_ns) return 0;
  return static_cast<double>(*sum.last_ns - *sum.first_ns) / 1e9;
}

nlohmann::json json_from(const SessionSum& sum) {
  const SessionRecord& about = *sum.about;
  nlohmann::json counts = nlohmann::json::object();
  for (const auto& [topic, count] : sum.records) counts[std::string(name_of(topic))] = count;
  nlohmann::json settings = nlohmann::json::object();
  for (const auto& [name, value] : about.settings) settings[name] = value;
  return {{"id", about.id},
          {"program", about.program},
          {"version", about.version},
          {"airframe", about.airframe},
          {"mission", about.mission},
          {"package_sha256", about.package ? nlohmann::json(about.package->hex()) : nlohmann::json()},
          {"first", sum.first_ns ? time_text(*sum.first_ns) : ""},
          {"last", sum.last_ns ? time_text(*sum.last_ns) : ""},
          {"seconds", seconds(sum)},
          {"segments", sum.segments},
          {"bytes", sum.bytes},
          {"clean_shutdown", clean(sum)},
          {"dropped", sum.end != nullptr ? nlohmann::json(sum.end->dropped) : nlohmann::json()},
          {"records", counts},
          {"settings", settings}};
}

void print(std::ostream& out, const SessionSum& sum) {
  const SessionRecord& about = *sum.about;
  Figures figures{{"session", about.id},
                  {"program", about.program + " " + about.version},
                  {"airframe", about.airframe.empty() ? "unknown" : about.airframe},
                  {"map", about.package ? about.mission + ", manifest " + about.package->hex().substr(0, 16) : "none"},
                  {"time", fmt::format("{} to {}, {:.1f} s", time_text(sum.first_ns.value_or(0)),
                                       time_text(sum.last_ns.value_or(0)), seconds(sum))},
                  {"files", fmt::format("{}, {:.2f} MB", sum.segments, static_cast<double>(sum.bytes) / 1e6)},
                  {"end", clean(sum) ? "clean: " + sum.end->reason : "truncated"}};
  for (const auto& [topic, count] : sum.records) figures.emplace_back(name_of(topic), std::to_string(count));
  print_figures(out, figures);
}

class RecorderInfoCommand final : public Command {
 public:
  std::string_view group() const override { return "recorder"; }
  std::string_view name() const override { return "info"; }
  std::string_view summary() const override { return "show the contents of a recording"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path recording_;
};

std::string_view RecorderInfoCommand::details() const {
  return R"(RECORDING: a folder written by the recorder, or any MCAP file. Lists each session with its records
by topic, and how it ended. Damage is not an error here: nadir recorder verify checks for it.

Exit codes: 0 shown, 2 the recording cannot be read.)";
}

std::string_view RecorderInfoCommand::examples() const {
  return R"(nadir recorder info recording
nadir recorder info recording --json | jq '.sessions[].clean_shutdown')";
}

void RecorderInfoCommand::setup(Options& options) {
  options.positional("RECORDING", recording_, "folder of segments, or an MCAP file").required();
}

int RecorderInfoCommand::run(Context& context) {
  const auto segments = read_recording(recording_, [](const Recorded&) {});
  nlohmann::json list = nlohmann::json::array(), files = nlohmann::json::array();
  for (const std::string& id : sessions_of(segments)) {
    const SessionSum sum = sum_of(segments, id);
    if (!list.empty() && !context.json) context.out << '\n';
    if (!context.json) print(context.out, sum);
    list.push_back(json_from(sum));
  }
  for (const SegmentContents& segment : segments) {
    const McapContents& mcap = segment.mcap;
    files.push_back({{"file", segment.segment.path.filename().string()},
                     {"session", segment.session ? segment.session->id : ""},
                     {"bytes", segment.segment.bytes},
                     {"messages", mcap.messages},
                     {"chunks", mcap.chunks},
                     {"finished", mcap.finished}});
    if (segment.session || context.json) continue;
    context.out << printable(fmt::format("{}  not a Nadir recording: {} in {}, profile \"{}\"",
                                         segment.segment.path.filename().string(), count(mcap.messages, "message"),
                                         count(mcap.channels.size(), "topic"), mcap.profile))
                << '\n';
  }
  if (context.json) print_json(context.out, {{"sessions", std::move(list)}, {"files", std::move(files)}});
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_recorder_info() { return std::make_unique<RecorderInfoCommand>(); }

}  // namespace nadir
