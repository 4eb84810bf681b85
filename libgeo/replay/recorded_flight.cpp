#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>

#include "base/error.hpp"
#include "base/files.hpp"
#include "recorder/recording.hpp"
#include "replay/flight_recording.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

// A name from a recording is not believed to be one.
bool plain_name(const std::string& name) {
  return !name.empty() && fs::path(name).filename() == name && name != ".." && name != ".";
}

void check_pictures(const RecordedFlight& recorded, const std::vector<InputRecord>& inputs) {
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    const fs::path path = recorded.flight.picture(i);
    if (inputs[i].picture_bytes == 0) continue;  // it was missing then as well
    const bool there = plain_name(recorded.flight.files.empty() ? inputs[i].telemetry.frame : recorded.flight.files[i]) &&
                       fs::is_regular_file(path);
    if (there && sha256_file(path) == inputs[i].picture) continue;
    throw UsageError(
        {.what = there ? "this is not the picture of the flight" : "a picture of the flight is missing",
         .where = path,
         .expected = fmt::format("{} bytes with SHA-256 {}", inputs[i].picture_bytes, inputs[i].picture.hex()),
         .fix = "give the folder of the recorded flight's pictures with --frames"});
  }
}

}  // namespace

std::string chosen_session(const fs::path& recording, const std::optional<std::string>& asked) {
  const std::vector<std::string> ids = sessions_of(read_recording(recording, [](const Recorded&) {}));
  if (asked && std::find(ids.begin(), ids.end(), *asked) != ids.end()) return *asked;
  if (ids.size() == 1 && !asked) return ids.front();
  throw UsageError({.what = ids.empty() ? "the recording has no session" : "it is not clear which session is meant",
                    .where = recording,
                    .expected = fmt::format("--session with one of: {}", fmt::join(ids, ", ")),
                    .found = asked.value_or("none"),
                    .fix = "nadir recorder info lists the sessions"});
}

RecordedFlight read_recorded_flight(const RecordedFlightSource& source) {
  const std::string id = chosen_session(source.recording, source.session);
  RecordedFlight recorded;
  std::map<std::uint64_t, InputRecord> inputs;
  std::map<std::uint64_t, std::string> pictures;
  read_recording(source.recording, [&](const Recorded& one) {
    if (!one.segment.session || one.segment.session->id != id) return;
    if (const auto* session = std::get_if<SessionRecord>(&one.record)) recorded.session = *session;
    if (const auto* input = std::get_if<InputRecord>(&one.record)) {
      if (input->index == 0) recorded.first_input_ns = one.at_ns;
      inputs.emplace(input->index, *input);
    }
    if (const auto* estimate = std::get_if<EstimateRecord>(&one.record)) recorded.estimates.push_back(*estimate);
    if (const auto* anchor = std::get_if<AnchorRecord>(&one.record)) {
      recorded.between.emplace_back(
          LateAnchor{anchor->index, anchor->taken_after, anchor->anchor.verdict != AnchorVerdict::not_tried});
    }
    if (const auto* hint = std::get_if<HintRecord>(&one.record)) recorded.between.emplace_back(*hint);
    const auto* picture = std::get_if<PictureRecord>(&one.record);
    if (picture == nullptr || source.frames) return;
    std::string name = fmt::format("{:08}", picture->index);
    write_file_atomic(source.unpacked / name, ByteView(picture->encoded));
    pictures.emplace(picture->index, std::move(name));
  });
  std::vector<InputRecord> flown;
  for (auto& [index, input] : inputs) {
    if (index != flown.size()) break;
    flown.push_back(std::move(input));
  }
  if (flown.empty()) {
    throw UsageError({.what = "the recording has no inputs from the beginning of its flight",
                      .where = source.recording,
                      .fix = "older segments were deleted, or nothing was flown: nadir recorder info shows it"});
  }
  recorded.unusable_inputs = inputs.size() - flown.size();
  if (pictures.empty() && !source.frames) {
    throw UsageError({.what = "the recording names its pictures but does not hold them",
                      .where = source.recording,
                      .fix = "give their folder with --frames"});
  }
  recorded.flight.camera = recorded.session.camera;
  recorded.flight.frames_folder = source.frames.value_or(source.unpacked);
  for (const InputRecord& input : flown) {
    recorded.flight.frames.push_back(input.telemetry);
    const auto kept = pictures.find(input.index);
    if (!source.frames)
      recorded.flight.files.push_back(kept == pictures.end() ? fmt::format("{:08}", input.index) : kept->second);
  }
  check_pictures(recorded, flown);
  return recorded;
}

}  // namespace nadir
