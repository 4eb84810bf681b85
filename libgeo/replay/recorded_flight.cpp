#include "replay/recorded_flight.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "base/error.hpp"
#include "base/files.hpp"
#include "recorder/record_codec.hpp"
#include "recorder/recording.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

// Empty for an image that cannot be read: the localizer could not decode it either.
Bytes encoded_image(const fs::path& path) {
  try {
    return read_file(path);
  } catch (const Error&) {
    return {};
  }
}

RecorderOptions lossless(const fs::path& folder, bool keep_images) {
  RecorderOptions options;
  options.store.folder = folder;
  options.store.sync = false;  // the folder is synced when it is done
  options.store.budget_bytes = std::uint64_t{1} << 50;
  options.when_full = WhenFull::wait;
  options.keep_pictures = keep_images;
  return options;
}

}  // namespace

ReplayRecording::ReplayRecording(const fs::path& folder, SessionRecord session, bool keep_images)
    : folder_(folder),
      recorder_(lossless(folder, keep_images), std::move(session), [this] { return now_ns_.load(); }) {}

void ReplayRecording::before(std::uint64_t index, const Telemetry& telemetry, const fs::path& image) {
  now_ns_ = static_cast<std::uint64_t>(std::clamp(telemetry.time_s, 0.0, 9e9) * 1e9);
  record_input(recorder_, index, telemetry, encoded_image(image));
}

void ReplayRecording::after(std::uint64_t index, const FrameReport& report) { record_frame(recorder_, index, report); }

void ReplayRecording::close() {
  recorder_.close("replayed");
  const StoreStatus status = recorder_.status();
  if (!status.stopped && status.dropped.empty()) return;
  throw Error({.what = "the recording is not complete", .where = folder_, .found = status.error});
}

Reproduction compare_estimates(const std::vector<EstimateRecord>& recorded, const std::vector<EstimateRecord>& flown) {
  const auto bits = [](EstimateRecord record) {
    record.estimate.latency_ms = 0;
    return encode(Record(std::move(record)));
  };
  Reproduction result;
  // Both are in the order of the flight; a recording that lost some has fewer.
  auto at = flown.begin();
  for (const EstimateRecord& one : recorded) {
    const Bytes wanted = bits(one);
    ++result.compared;
    auto found = at;
    while (found != flown.end() && found->index <= one.index && bits(*found) != wanted) ++found;
    if (found != flown.end() && found->index == one.index) {
      ++result.same;
      at = found + 1;
    } else if (!result.first_other) {
      result.first_other = one.estimate.frame;
    }
  }
  return result;
}

namespace fs = std::filesystem;
namespace {

// A name from a recording may be anything.
bool plain_name(const std::string& name) {
  return !name.empty() && fs::path(name).filename() == name && name != ".." && name != ".";
}

void check_pictures(const RecordedFlight& recorded, const std::vector<InputRecord>& inputs) {
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    const fs::path path = recorded.flight.image_path(i);
    if (inputs[i].picture_bytes == 0) continue;  // it was missing then as well
    const bool there =
        plain_name(recorded.flight.files.empty() ? inputs[i].telemetry.frame : recorded.flight.files[i]) &&
        fs::is_regular_file(path);
    if (there && sha256_file(path) == inputs[i].picture) continue;
    throw UsageError(
        {.what = there ? "this is not the image of the flight" : "an image of the flight is missing",
         .where = path,
         .expected = fmt::format("{} bytes with SHA-256 {}", inputs[i].picture_bytes, inputs[i].picture.hex()),
         .fix = "give the folder of the recorded flight's frames with --frames"});
  }
}

}  // namespace

RecordedFlight read_recorded_flight(const RecordedFlightSource& source) {
  const std::string id = chosen_session(source.recording, source.session);
  RecordedFlight recorded;
  std::map<std::uint64_t, InputRecord> inputs;
  std::map<std::uint64_t, std::string> pictures;
  const auto segments = read_recording(source.recording, [&](const Recorded& one) {
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
    if (const auto* fix = std::get_if<FixRecord>(&one.record)) recorded.fixes.push_back(*fix);
    if (const auto* made_of = std::get_if<FixInputRecord>(&one.record)) recorded.fix_inputs.push_back(*made_of);
    const auto* picture = std::get_if<FrameRecord>(&one.record);
    if (picture == nullptr || source.frames) return;
    std::string name = fmt::format("{:08}", picture->index);
    write_file_atomic(source.unpacked / name, ByteView(picture->encoded));
    pictures.emplace(picture->index, std::move(name));
  });
  recorded.missing_between = missing_records(segments, id, Topic::anchor) + missing_records(segments, id, Topic::hint);
  std::vector<InputRecord> flown;
  for (auto& [index, input] : inputs) {
    if (index != flown.size()) break;
    flown.push_back(std::move(input));
  }
  if (flown.empty()) {
    throw UsageError({.what = "the recording has no inputs from the beginning of its flight",
                      .where = source.recording,
                      .fix = "older segments were deleted, or nothing was flown: see nadir recorder info"});
  }
  recorded.unusable_inputs = inputs.size() - flown.size();
  if (pictures.empty() && !source.frames) {
    throw UsageError({.what = "the recording does not hold its images",
                      .where = source.recording,
                      .fix = "give the folder of the frames with --frames"});
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
