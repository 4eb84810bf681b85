#include "desk/desk_service.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>

#include <algorithm>
#include <cerrno>
#include <random>
#include <utility>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/plural.hpp"
#include "base/printable.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr const char* kFlightsFolder = "flights";
constexpr const char* kPackagesFolder = "packages";
constexpr const char* kImportsFolder = "imports";
constexpr std::size_t kImportBatch = 50;  // pictures that become part of a flight at once, and …
constexpr std::uint64_t kImportBatchBytes = std::uint64_t{128} << 20;  // … their bytes, in memory
constexpr std::size_t kIdDigits = 12;
constexpr auto kResumeInterval = std::chrono::milliseconds(500);

bool is_flight_id(std::string_view id) {
  return id.size() == kIdDigits && id.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

fs::path made(const fs::path& folder) {
  std::error_code code;
  fs::create_directories(folder, code);
  if (!code) return folder;
  throw Error({.what = "cannot create the desk's folder",
               .where = folder.string(),
               .found = code.message(),
               .fix = "check the owner of the folder above it, and its disk"});
}

FileDescriptor lock_root(const fs::path& root) {
  made(root / kFlightsFolder);
  made(root / kPackagesFolder);
  FileDescriptor lock(::open((root / "lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0644));
  if (!lock) {
    throw Error({.what = "cannot write to the desk's folder",
                 .where = root.string(),
                 .found = system_error_text(errno),
                 .fix = "check its owner and its disk, or choose another --root"});
  }
  if (::flock(lock.get(), LOCK_EX | LOCK_NB) == 0) return lock;
  throw UsageError({.what = "another desk uses this folder",
                    .where = root.string(),
                    .fix = "stop that one first, or choose another --root"});
}

DeskOptions completed(DeskOptions options) {
  options.store.limits = options.limits.pictures;
  if (!options.judged_at) options.judged_at = [] { return SystemClock().now(); };
  if (!options.new_id) options.new_id = random_flight_id;
  if (options.program.empty()) options.program = fs::read_symlink("/proc/self/exe");
  options.sources.trust = options.trust;
  return options;
}

UtcMillis created_at(const FlightStore& store) {
  const std::vector<EventRow> first = store.events_after(0, 1);
  return first.empty() ? UtcMillis{} : first.front().time;
}

}  // namespace

std::string random_flight_id() {
  std::random_device random;
  return fmt::format("{:08x}{:04x}", random(), random() & 0xffffU);
}

DeskService::DeskService(DeskOptions options)
    : options_(completed(std::move(options))),
      lock_(lock_root(options_.root)),
      packages_(options_.root / kPackagesFolder, options_.trust, options_.judged_at),
      imports_(options_.root / kImportsFolder, options_.limits.imports, options_.new_id),
      planning_({.root = options_.root,
                 .sources = options_.sources,
                 .program = options_.program,
                 .at = options_.at,
                 .now = options_.judged_at,
                 .new_id = options_.new_id}),
      slots_(std::max<std::size_t>(1, options_.limits.engines)) {
  read_flights();
  resuming_ = std::jthread([this](const std::stop_token& stop) { resume_flights(stop); });
}

DeskService::~DeskService() {
  resuming_ = {};
  live_.clear();
}

fs::path DeskService::folder_of(std::string_view id) const { return options_.root / kFlightsFolder / id; }

// Each flight is opened once: what a killed desk was storing is tidied up, and what it left to do is known.
void DeskService::read_flights() {
  const std::lock_guard lock(mutex_);
  for (const auto& entry : fs::directory_iterator(options_.root / kFlightsFolder)) {
    const std::string id = entry.path().filename().string();
    if (!is_flight_id(id)) continue;
    // A kill before the first transaction leaves a folder that was never reported.
    FlightSummary summary{.id = id, .name = {}, .package = {}, .created = {}, .status = {}, .damaged = {}};
    try {
      if (!FlightStore::exists(entry.path())) continue;
      if (make_room()) {
        const auto flight = adopt(FlightStore::open(entry.path(), options_.store), id);
        if (!flight->busy()) live_.remove(flight);
        continue;
      }
      // All places are taken by flights at work.
      const auto store = FlightStore::open(entry.path(), options_.store);
      summary.name = store->description().name;
      summary.package = store->description().package;
      summary.created = created_at(*store);
      summary.status.accepted = store->accepted();
      summary.status.processed = store->processed();
      unfinished_.push_back(id);
    } catch (const Error& error) {
      summary.damaged = error.text().what + (error.text().found.empty() ? "" : ": " + error.text().found);
    }
    known_.insert_or_assign(id, std::move(summary));
  }
}

// Opens the flights that have work to do as places become free.
void DeskService::resume_flights(const std::stop_token& stop) {
  std::mutex sleeping;
  std::condition_variable_any never;
  for (;;) {
    std::string next;
    {
      const std::lock_guard lock(mutex_);
      if (unfinished_.empty()) return;
      next = unfinished_.front();
    }
    try {
      open(next);
      const std::lock_guard lock(mutex_);
      unfinished_.erase(unfinished_.begin());
      continue;
    } catch (const DeskBusy&) {
    } catch (const Error& error) {
      const std::lock_guard lock(mutex_);
      known_[next].damaged = error.text().what;
      unfinished_.erase(unfinished_.begin());
      continue;
    }
    std::unique_lock lock(sleeping);
    never.wait_for(lock, stop, kResumeInterval, [] { return false; });
    if (stop.stop_requested()) return;
  }
}

std::shared_ptr<LiveFlight> DeskService::find_live(std::string_view id) {
  const auto found = std::find_if(live_.begin(), live_.end(), [id](const auto& flight) { return flight->id() == id; });
  if (found == live_.end()) return nullptr;
  live_.splice(live_.begin(), live_, found);
  return live_.front();
}

bool DeskService::make_room() {
  if (live_.size() < options_.limits.live_flights) return true;
  for (auto at = live_.end(); at != live_.begin();) {
    --at;
    // Nobody else holds it, and nobody else can take hold of it while the mutex is held.
    if (at->use_count() != 1 || (*at)->busy()) continue;
    known_.insert_or_assign((*at)->id(), summary(**at));
    live_.erase(at);
    return true;
  }
  return false;
}

std::shared_ptr<LiveFlight> DeskService::adopt(std::unique_ptr<FlightStore> store, const std::string& id) {
  auto flight = std::make_shared<LiveFlight>(id, std::move(store), folder_of(id), packages_, slots_, options_.clock);
  known_.insert_or_assign(id, summary(*flight));
  live_.push_front(flight);
  return flight;
}

std::shared_ptr<LiveFlight> DeskService::create(const NewFlight& flight) {
  check_space(0);
  std::shared_ptr<const DeskPackage> package;
  if (!flight.package.empty()) {
    const auto listing = packages_.find(flight.package);
    if (!listing || !listing->package) {
      throw UsageError({.what = "the map package cannot be used",
                        .where = flight.package,
                        .found = listing ? listing->reason : "no such package",
                        .fix = "choose one of those that GET /v1/packages lists as accepted"});
    }
    package = listing->package;
  }
  const FlightDescription description =
      describe_flight(printable(flight.name), flight.camera_text, flight.start, flight.package, package.get());
  const std::lock_guard lock(mutex_);
  if (known_.size() >= options_.limits.flights) {
    throw OutOfSpace({.what = "the desk holds as many flights as it may",
                      .expected = fmt::format("fewer than {}", count(options_.limits.flights, "flight")),
                      .fix = "move flights that are finished out of its folder, and start it again"});
  }
  if (!make_room()) throw DeskBusy({.what = "all places for open flights are taken", .fix = "try again later"});
  std::string id = options_.new_id();
  while (known_.contains(id) || fs::exists(folder_of(id))) id = options_.new_id();
  return adopt(FlightStore::create(folder_of(id), description, options_.clock(), options_.store), id);
}

FinishedImport DeskService::finish_import(std::string_view id, NewFlight flight, const ImportRequest& stated) {
  FinishedImport finished;
  const ImportedPhotos imported = imports_.import(id, stated, flight.camera_text);
  finished.result = imported.result;
  if (finished.result.findings.has_errors()) return finished;
  const auto begun = imports_.flight_of(id);
  if (begun) finished.flight = open(*begun);
  if (!finished.flight) {
    flight.camera_text = imported.camera_text;
    if (!flight.start) flight.start = finished.result.start;
    finished.flight = create(flight);
    imports_.set_flight(id, finished.flight->id());
  }

  std::vector<Bytes> held;
  std::vector<PictureOffer> batch;
  std::uint64_t held_bytes = 0;
  const auto send = [&] {
    for (PictureAnswer& answer : finished.flight->accept(batch)) finished.answers.push_back(std::move(answer));
    batch.clear(), held.clear(), held_bytes = 0;
  };
  held.reserve(kImportBatch);
  for (std::size_t i = 0; i < imported.rows.size(); ++i) {
    held.push_back(read_file(imported.photos[i], options_.limits.imports.file_bytes));
    held_bytes += held.back().size();
    check_space(held_bytes);
    batch.push_back(
        {.name = imported.rows[i].frame, .telemetry = imported.rows[i], .bytes = held.back(), .folder = nullptr});
    if (batch.size() == kImportBatch || held_bytes >= kImportBatchBytes) send();
  }
  if (!batch.empty()) send();
  imports_.remove(id);
  return finished;
}

std::shared_ptr<LiveFlight> DeskService::open(std::string_view id) {
  const std::lock_guard lock(mutex_);
  const auto known = known_.find(id);
  if (known == known_.end()) return nullptr;
  if (auto flight = find_live(id)) return flight;
  if (!make_room()) throw DeskBusy({.what = "all places for open flights are taken", .fix = "try again later"});
  return adopt(FlightStore::open(folder_of(id), options_.store), std::string(id));
}

FlightSummary DeskService::summary(const LiveFlight& flight) const {
  const FlightDescription& description = flight.store().description();
  return {.id = flight.id(),
          .name = description.name,
          .package = description.package,
          .created = created_at(flight.store()),
          .status = flight.status(),
          .damaged = {}};
}

std::vector<FlightSummary> DeskService::list() {
  const std::lock_guard lock(mutex_);
  for (const auto& flight : live_) known_.insert_or_assign(flight->id(), summary(*flight));
  std::vector<FlightSummary> flights;
  for (const auto& [id, summary] : known_) flights.push_back(summary);
  std::sort(flights.begin(), flights.end(), [](const FlightSummary& one, const FlightSummary& other) {
    return std::pair(other.created, one.id) < std::pair(one.created, other.id);
  });
  return flights;
}

void DeskService::check_space(std::uint64_t bytes) const {
  std::error_code code;
  const fs::space_info space = fs::space(options_.root, code);
  const std::uint64_t needed = bytes + options_.limits.keep_free_bytes;
  if (code || space.available >= needed) return;
  throw OutOfSpace({.what = "the disk of the desk is full",
                    .where = options_.root.string(),
                    .expected = fmt::format("{} MB free", needed / 1'000'000),
                    .found = fmt::format("{} MB", space.available / 1'000'000),
                    .fix = "free space on it, and send the same again"});
}

}  // namespace nadir
