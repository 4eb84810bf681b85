#include "replay/flight_recording.hpp"

#include <algorithm>
#include <cmath>

#include "base/error.hpp"
#include "base/files.hpp"
#include "recorder/record_codec.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

// What the localizer could not decode is no picture; neither is what cannot be read.
Bytes encoded_picture(const fs::path& path) {
  try {
    return read_file(path);
  } catch (const Error&) {
    return {};
  }
}

RecorderOptions lossless(const fs::path& folder, bool keep_pictures) {
  RecorderOptions options;
  options.store.folder = folder;
  options.store.sync = false;  // the folder is synced when it is done
  options.store.budget_bytes = std::uint64_t{1} << 50;
  options.when_full = WhenFull::wait;
  options.keep_pictures = keep_pictures;
  return options;
}

}  // namespace

ReplayRecording::ReplayRecording(const fs::path& folder, SessionRecord session, bool keep_pictures)
    : folder_(folder),
      recorder_(lossless(folder, keep_pictures), std::move(session), [this] { return now_ns_.load(); }) {}

void ReplayRecording::before(std::uint64_t index, const Telemetry& told, const fs::path& picture) {
  now_ns_ = static_cast<std::uint64_t>(std::clamp(told.time_s, 0.0, 9e9) * 1e9);
  record_input(recorder_, index, told, encoded_picture(picture));
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

}  // namespace nadir
