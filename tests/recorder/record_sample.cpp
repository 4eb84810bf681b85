// A recorder for tests from outside.
//   record_sample DIR          one recording with every kind of record, ended cleanly
//   record_sample DIR old      the same without fixes, which earlier versions did not record
//   record_sample DIR forever  estimates without end; says "on disk N" when N of them have been handed to the disk
#include <cstdio>
#include <string_view>

#include "recorder/recorder.hpp"
#include "recorder/sample_records.hpp"

namespace {

using namespace nadir;

constexpr std::uint64_t kStart_ns = 1'760'000'000'000'000'000, kFrame_ns = 333'000'000;

void record_all(const std::filesystem::path& folder, bool fixes) {
  std::uint64_t now_ns = kStart_ns;
  RecorderOptions options;
  options.store.folder = folder;
  options.store.sync = false;
  options.store.segment_ns = 40 * kFrame_ns;
  options.when_full = WhenFull::wait;
  Recorder recorder(options, test::sample_session(), [&] { return now_ns; });
  Random random(9);
  for (std::uint64_t i = 0; i < 100; ++i) {
    recorder.flush();  // the thread rests while the clock is set
    now_ns += kFrame_ns;
    recorder.record(test::sample_input(i));
    recorder.record(test::sample_estimate(i));
    if (i % 20 != 0) continue;
    for (Record& record : test::sample_records(random)) {
      if (topic_of(record) != Topic::session && topic_of(record) != Topic::end &&
          (fixes || (topic_of(record) != Topic::fix && topic_of(record) != Topic::fix_input)))
        recorder.record(std::move(record));
    }
  }
  recorder.flush();
  recorder.close("sample is over");
}

void record_forever(const std::filesystem::path& folder) {
  StoreOptions options;
  options.folder = folder;
  options.sync = false;
  options.segment_bytes = 60'000;
  SegmentStore store(options, test::sample_session());
  for (std::uint64_t i = 0;; ++i) {
    store.put(test::sample_estimate(i), kStart_ns + i * kFrame_ns);
    if (i % 7 != 0) continue;
    store.flush(kStart_ns + i * kFrame_ns);
    std::printf("on disk %llu\n", static_cast<unsigned long long>(i + 1));
    std::fflush(stdout);
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) return 2;
  if (argc > 2 && std::string_view(argv[2]) == "forever") {
    record_forever(argv[1]);
  } else {
    record_all(argv[1], argc == 2);
  }
  return 0;
}
