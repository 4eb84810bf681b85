#include "commands/recorder/recover.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <ostream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
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

}  // namespace

std::string_view RecorderRecoverCommand::details() const {
  return "Copies every message that can be read, with its schema, times and number, into new files with index and "
         "footer.\n"
         "A chunk that is damaged is left out; a file that was cut is read up to its last whole chunk. Works on any "
         "MCAP\n"
         "file; attachments and metadata are not carried over. RECORDING stays as it is; OUT appears when it is "
         "whole.\n\n"
         "Exit codes: 0 everything that was written is there, 1 something was damaged and left out, 2 could not be "
         "done.";
}

std::string_view RecorderRecoverCommand::examples() const {
  return "nadir recorder recover recording --out recovered\n"
         "nadir recorder recover 000003.flight.mcap --out whole.mcap";
}

void RecorderRecoverCommand::setup(Options& options) {
  options.positional("RECORDING", recording_, "a folder of segments, or an MCAP file").required();
  options.value("--out", out_, "OUT", "folder, or file, that is made").required();
}

int RecorderRecoverCommand::run(Context& context) {
  nlohmann::json files = nlohmann::json::array();
  bool damaged = false;
  const auto recover = [&](const fs::path& source, const fs::path& target) {
    const McapContents contents = recover_mcap(source, target);
    damaged = damaged || contents.findings.refuses();
    files.push_back(json_from(source, contents));
    if (context.json) return;
    context.out << fmt::format("{}  {} messages, {} chunks left out, {} of {} bytes readable\n",
                               source.filename().string(), contents.messages, contents.damaged_chunks,
                               contents.whole_size, contents.size);
  };
  if (fs::is_directory(recording_)) {
    const std::vector<Segment> segments = segments_in(recording_);
    if (segments.empty()) throw UsageError({.what = "the folder holds no recording", .where = recording_});
    StagingDirectory staging(out_);
    for (const Segment& segment : segments) recover(segment.path, staging.path() / segment.path.filename());
    staging.commit();
  } else {
    recover(recording_, out_);
  }
  if (context.json) print_json(context.out, {{"files", std::move(files)}});
  return damaged ? kRefused : kAccepted;
}

}  // namespace nadir
