// nadir recorder verify: can this recording be relied on?.
#include <filesystem>
#include <nlohmann/json.hpp>

#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "recorder/recording.hpp"

namespace nadir {
namespace {

class RecorderVerifyCommand final : public Command {
 public:
  std::string_view group() const override { return "recorder"; }
  std::string_view name() const override { return "verify"; }
  std::string_view summary() const override { return "check a recording for damage, losses and a clean end"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path recording_;
};

std::string_view RecorderVerifyCommand::details() const {
  return R"(Reads every byte: chunks against their CRCs, indexes against the messages, payloads against their
schemas, sequence numbers for gaps, and the last record for clean_shutdown. A recording that was
truncated or reports losses is accepted with warnings: what it contains is intact. A damaged
recording is rejected.

Exit codes: 0 intact, 1 damaged (the findings state where), 2 the recording cannot be read.)";
}

std::string_view RecorderVerifyCommand::examples() const { return R"(nadir recorder verify recording)"; }

void RecorderVerifyCommand::setup(Options& options) {
  options.positional("RECORDING", recording_, "folder of segments, or an MCAP file").required();
}

int RecorderVerifyCommand::run(Context& context) {
  const auto segments = read_recording(recording_, [](const Recorded&) {});
  std::uint64_t messages = 0;
  for (const SegmentContents& segment : segments) messages += segment.mcap.messages;
  return report_findings(context.out, context.json, check_recording(segments),
                         {{"files", segments.size()}, {"messages", messages}});
}

}  // namespace

std::unique_ptr<Command> make_recorder_verify() { return std::make_unique<RecorderVerifyCommand>(); }

}  // namespace nadir
