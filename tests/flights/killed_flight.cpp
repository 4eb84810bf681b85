// A process that works at a stored flight until it is killed.
//
// Usage: killed_flight FOLDER accept           stores batches of three pictures, and a fix after each fifth, for ever;
//                                              says "accepted N" or "fix N" when they are stored
//        killed_flight FOLDER fly COURSE N     processes and completes the flight; kills itself when the store is about
//                                              to commit, or has committed, for the N-th time (0: never)
//        killed_flight FOLDER place N          the same with a flight that floats, and is placed as a whole
//        killed_flight FOLDER cross N          … and with two passes, of which the second one is placed by the first
// Exit codes: 0 done, 2 an error, its text on stderr.
#include <csignal>
#include <cstdio>
#include <string>
#include <string_view>

#include "base/error.hpp"
#include "flights/floating_flight.hpp"

namespace nadir::test {
namespace {

void accept_for_ever(const std::filesystem::path& folder) {
  const auto store = FlightStore::exists(folder) ? FlightStore::open(folder)
                                                 : FlightStore::create(folder, description(Course::smooth), kNow);
  for (int batch = 1;; ++batch) {
    std::vector<EncodedPicture> pictures;
    for (int i = 0; i < 3; ++i) pictures.push_back(plain_picture(static_cast<int>(store->accepted()) + i));
    store->accept(offers(pictures), kNow);
    std::printf("accepted %zu\n", store->accepted());
    std::fflush(stdout);
    if (batch % 5 != 0) continue;
    std::printf("fix %lld\n", static_cast<long long>(store->add_fix(start(), 50, "test", kNow).id));
    std::fflush(stdout);
  }
}

void fly(const std::filesystem::path& folder, Course course, int fatal_commit) {
  int commits = 0;
  FlightStoreOptions options;
  options.hook = [&](std::string_view /*transaction*/, bool /*committed*/) {
    if (++commits == fatal_commit) ::raise(SIGKILL);
  };
  const auto store = FlightStore::open(folder, options);
  FlightEngine engine(*store, engine_setup(course), {.clock = [] { return kNow; }});
  engine.process();
  engine.complete();
}

void place(const std::filesystem::path& folder, const FlightEngineSetup& setup, int fatal_commit) {
  int commits = 0;
  FlightStoreOptions options;
  options.hook = [&](std::string_view /*transaction*/, bool /*committed*/) {
    if (++commits == fatal_commit) ::raise(SIGKILL);
  };
  const auto store = FlightStore::open(folder, options);
  FlightEngine engine(*store, setup, {.clock = [] { return kNow; }});
  engine.process();
  while (engine.place_segments(SegmentPlacer::Scope::all, 1000)) {
  }
  const auto last = store->events_after(store->last_event() - 1, 1);
  if (last.empty() || last[0].event.kind != FlightEventKind::flight_completed) engine.complete();
}

}  // namespace
}  // namespace nadir::test

int main(int argc, char** argv) {
  using namespace nadir::test;
  const std::string_view mode = argc > 2 ? argv[2] : "";
  try {
    if (mode == "accept") accept_for_ever(argv[1]);
    if ((mode == "place" || mode == "cross") && argc == 4) {
      place(argv[1], mode == "place" ? floating_setup() : crossing_setup(), std::stoi(argv[3]));
      return 0;
    }
    if (mode != "fly" || argc != 5) return 64;
    fly(argv[1], argv[3] == std::string_view("eventful") ? Course::eventful : Course::smooth, std::stoi(argv[4]));
    return 0;
  } catch (const nadir::Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}
