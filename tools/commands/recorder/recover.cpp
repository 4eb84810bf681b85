// nadir recorder recover: finished files of what is left of a damaged or cut recording.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <ostream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "recorder/recording.hpp"
#include "recorder/segments.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

nlohmann::json json_from(const fs::path& path, const McapContents& contents) {
  return {{"file", path.filename().string()},
          {"messages", contents.messages},
          {"chunks", contents.chunks},
          {"damaged_chunks", contents.damaged_chunks},
          {"finished", contents.finished},
          {"bytes", contents.size},
          {"readable_bytes", contents.whole_size},
          {"attachments_left_out", contents.attachments},
          {"metadata_left_out", contents.metadata}};
}

class RecorderRecoverCommand final : public Command {
 public:
  std::string_view group() const override { return "recorder"; }
  std::string_view name() const override { return "recover"; }
  std::string_view summary() const override { return "recover the readable part of a damaged or truncated recording"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path recording_, out_;
};

std::string_view RecorderRecoverCommand::details() const {
  return R"(Copies every readable message, with its schema, times and sequence number, to new files with index
and footer. Damaged chunks are left out; a truncated file is read up to its last complete chunk.
Works on any MCAP file; attachments and metadata are not carried over. RECORDING does not change;
OUT appears when it is complete.

Exit codes: 0 everything was recovered, 1 damaged parts were left out, 2 the job could not be done.)";
}

std::string_view RecorderRecoverCommand::examples() const {
  return R"(nadir recorder recover recording --out recovered
nadir recorder recover 000003.flight.mcap --out whole.mcap)";
}

void RecorderRecoverCommand::setup(Options& options) {
  options.positional("RECORDING", recording_, "folder of segments, or an MCAP file").required();
  options.value("--out", out_, "OUT", "folder or file to create").required();
}

int RecorderRecoverCommand::run(Context& context) {
  nlohmann::json files = nlohmann::json::array();
  bool damaged = false;
  const auto recover = [&](const fs::path& source, const fs::path& target) {
    const McapContents contents = recover_mcap(source, target);
    damaged = damaged || contents.findings.has_errors();
    files.push_back(json_from(source, contents));
    if (context.json) return;
    context.out << fmt::format("{}  {}, {} left out, {} of {} bytes readable\n", printable(source.filename().string()),
                               count(contents.messages, "message"), count(contents.damaged_chunks, "chunk"),
                               contents.whole_size, contents.size);
  };
  if (fs::is_directory(recording_)) {
    const std::vector<Segment> segments = segments_in(recording_);
    if (segments.empty()) throw UsageError({.what = "the folder contains no recording", .where = recording_});
    StagingDirectory staging(out_);
    for (const Segment& segment : segments) recover(segment.path, staging.path() / segment.path.filename());
    staging.commit();
  } else {
    recover(recording_, out_);
  }
  if (context.json) print_json(context.out, {{"files", std::move(files)}});
  return damaged ? kRefused : kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_recorder_recover() { return std::make_unique<RecorderRecoverCommand>(); }

}  // namespace nadir
