// Integrity, judged on what nobody fitted to. Its parts, each of which may be resumed:
//
//   looks      looks that cannot be right, by the hundred thousand: how often their likelihood ratio claims that they
//              are, and whether a ratio is the evidence that it states (look_rates.hpp). --from: of stored results
//   repeats    looks in a row: how often a chance peak is seen again at the same place (repeated_looks.hpp)
//   table      results of both in the form that is stored, for drawing from (measured_looks.hpp)
//   splitting  P(misleading | fault), by multilevel splitting over flights whose looks are drawn from that table
//              (splitting.hpp, fault_flight.hpp, misleading.hpp)
//   plain      the same by counting flights, without a method (plain_flights.hpp)
//   tree       probabilities of splitting times assumed rates of faults: a rate per flight hour (fault_tree.hpp)
#include <fmt/format.h>

#include <iostream>
#include <opencv2/core/utility.hpp>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "base/platform.hpp"
#include "fault_tree.hpp"
#include "look_rates.hpp"
#include "misleading.hpp"
#include "plain_flights.hpp"
#include "repeated_looks.hpp"
#include "seeded_runs.hpp"

using namespace nadir;
using namespace nadir::bench;

namespace {

struct Options {
  std::string part = "looks";
  RunOptions run;
  LookPlan plan;
  std::filesystem::path data = data_folder(), plot;
  std::vector<std::filesystem::path> from;
  std::filesystem::path measured = "tests/integrity/data/measured_looks.csv",
                        repeated = "tests/integrity/data/repeated_looks.csv",
                        counted = "tests/integrity/data/plain_flights.csv";
  SplittingRun splitting;
  int repetitions = 20, flights = 100'000;
  std::vector<std::string> faults;
};

struct UnseenGrounds : Grounds {
  explicit UnseenGrounds(const Options& options)
      : Grounds(Purpose::judge, options.run.worlds, first_world(Purpose::judge), options.data) {
    if (real().empty()) std::cerr << "integrity: no real imagery: set NADIR_DATA or --data\n";
  }
};

// Of all files; pictures stay apart.
Looks stored_looks(const std::vector<std::filesystem::path>& files) {
  Looks all;
  std::uint64_t picture = 0;
  for (const std::filesystem::path& path : files) {
    const LooksFile file = read_looks(path);
    const std::uint64_t first = picture;
    for (const auto& [index, look] : file.looks) {
      const std::uint64_t own = file.shared_pictures ? index : LookTaker::kWindowsOfPicture * index;
      const std::uint64_t at = LookTaker::kWindowsOfPicture * first + own;
      all[at] = look;
      all[at].index = at;
      picture = picture_of(at) + 1;
    }
  }
  return all;
}

int looks(const Options& options) {
  Looks looks;
  if (!options.from.empty()) {
    looks = stored_looks(options.from);
  } else {
    const UnseenGrounds grounds(options);
    std::map<std::thread::id, std::unique_ptr<LookTaker>> takers;
    std::mutex mutex;
    const auto taker = [&]() -> LookTaker& {
      const std::lock_guard lock(mutex);
      auto& mine = takers[std::this_thread::get_id()];
      if (!mine) mine = std::make_unique<LookTaker>(grounds, options.plan, options.run.seed);
      return *mine;
    };
    looks = run_all<bench::Look>(options.run,
                                 look_header(options.run.seed, options.plan, grounds, LookTaker::kWindowsOfPicture),
                                 look_of, [&](std::uint64_t i) { return taker().take(i); });
  }
  std::cout << rate_tables(looks) << "\n" << picture_table(looks);
  if (!options.plot.empty()) write_file_atomic(options.plot, reliability_svg(looks));
  const std::string found = contradictions(looks);
  std::cout << "\n" << (found.empty() ? "no rate contradicts its bound\n" : found);
  return found.empty() ? 0 : 1;
}

int repeats(const Options& options) {
  const UnseenGrounds grounds(options);
  const std::string header = repeated_header(options.run.seed, options.plan, grounds);
  const RepeatedLooks looks = run_all<RepeatedLook>(options.run, header, repeated_look_of, [&](std::uint64_t i) {
    return take_repeated_look(grounds, options.plan, options.run.seed, i);
  });
  std::cout << RepeatRates("", looks).table();
  return 0;
}

PlainFile plain_of(std::span<const std::filesystem::path> paths, std::uint64_t seed) {
  PlainFile all = read_plain(paths.front(), seed);
  for (const std::filesystem::path& path : paths.subspan(1)) all.add(read_plain(path, seed));
  return all;
}

int table(const Options& options) {
  if (options.from.empty()) {
    throw UsageError(
        {.what = "no results to make the table from", .fix = "pass --from the CSV of --part looks, repeats or plain"});
  }
  if (is_plain_flights(options.from.front())) {
    write_file_atomic(options.counted, plain_of(options.from, options.run.seed).text());
    std::cout << options.counted.string() << "\n";
    return 0;
  }
  if (is_repeated_looks(options.from.front())) {
    const RepeatRates rates = RepeatRates::reduced(options.from.front());
    write_file_atomic(options.repeated, rates.text());
    std::cout << rates.table() << options.repeated.string() << "\n";
    return 0;
  }
  std::string origin = fmt::format("likelihood {}", look_likelihood_table().numbers_sha256.substr(0, 16));
  for (const std::filesystem::path& path : options.from) {
    const LooksFile file = read_looks(path);
    origin += fmt::format(" | {} looks, {}", file.looks.size(), file.run);
  }
  const MeasuredLooks measured = MeasuredLooks::reduced(origin, stored_looks(options.from));
  write_file_atomic(options.measured, measured.text());
  std::cout << measured.summary() << options.measured.string() << "\n";
  return 0;
}

std::string digest_of(const std::filesystem::path& path) { return sha256(as_bytes(read_text_file(path))).hex(); }

// Of the faults that were asked for, all repetitions; of all where none was. Throws Error for an unknown one.
std::vector<std::uint64_t> indices_of(const std::vector<std::string>& faults, int repetitions) {
  for (const std::string& fault : faults) fault_kind(fault);
  std::vector<std::uint64_t> indices;
  for (std::uint64_t repetition = 0; repetition < static_cast<std::uint64_t>(repetitions); ++repetition) {
    for (const FaultKind& kind : fault_kinds()) {
      if (faults.empty() || std::ranges::count(faults, kind.code) > 0) indices.push_back(number_of(kind, repetition));
    }
  }
  return indices;
}

// What flights draw from, and which of them are run.
struct DrawnFlights {
  MeasuredLooks looks;
  RepeatRates rates;
  std::vector<std::uint64_t> indices;

  DrawnFlights(Options& options, int repetitions)
      : looks(MeasuredLooks::read(options.measured)),
        rates(RepeatRates::read(options.repeated)),
        indices(indices_of(options.faults, repetitions)) {
    options.splitting.seed = options.run.seed;
    options.splitting.looks_origin = looks.origin();
    options.splitting.looks_sha256 = digest_of(options.measured);
    options.splitting.repeats_sha256 = digest_of(options.repeated);
    options.run.count = indices.size();
  }
};

int splitting(Options options) {
  const DrawnFlights drawn(options, options.repetitions);
  std::cout << drawn.rates.table() << "\n";
  const auto records = run_all<SplitRecord>(
      options.run, splitting_header(options.splitting), split_record_of,
      [&](std::uint64_t i) { return split(drawn.looks, drawn.rates, options.splitting, i); }, drawn.indices);
  std::cout << splitting_table(records);
  return 0;
}

int plain(Options options) {
  const DrawnFlights drawn(options, (options.flights + kFlightsInALine - 1) / kFlightsInALine);
  const auto counted = run_all<PlainFlights>(
      options.run, plain_header(options.splitting), plain_flights_of,
      [&](std::uint64_t i) { return count_plain(drawn.looks, drawn.rates, options.splitting, i); }, drawn.indices);
  std::cout << plain_table(counted);
  return 0;
}

int tree(const Options& options) {
  if (options.from.empty()) {
    throw UsageError(
        {.what = "no probabilities to compute the tree from", .fix = "pass --from the CSV of --part splitting"});
  }
  const SplittingFile file = read_splitting(options.from.front(), options.run.seed);
  CountedFlights counted;
  if (options.from.size() > 1) {
    const PlainFile plain = plain_of(std::span(options.from).subspan(1), options.run.seed);
    if (!file.run.ends_with(plain.run)) {
      throw UsageError({.what = "plain flights and splitting drew from different looks, or under different limits",
                        .expected = file.run,
                        .found = plain.run,
                        .fix = "run both with the same --measured and --repeated"});
    }
    counted = plain.sums;
  }
  const FaultTree tree = fault_tree(probabilities(file.records, counted), file.minutes);
  std::cout << splitting_table(file.records, counted) << "\n" << tree_table(tree);
  if (!options.plot.empty()) write_file_atomic(options.plot, tree_svg(tree));
  return 0;
}

int run(const Options& options) {
  if (purpose_of(options.run.seed) != Purpose::judge) {
    throw UsageError({.what = "seeds below a million were fitted to", .fix = "pass --seed 1000000 or more"});
  }
  if (options.part == "looks") return looks(options);
  if (options.part == "repeats") return repeats(options);
  if (options.part == "table") return table(options);
  if (options.part == "splitting") return splitting(options);
  return options.part == "plain" ? plain(options) : tree(options);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("How often a position is wrong and claims not to be, on unseen seeds, worlds and imagery.", "integrity");
  Options options;
  options.run.count = 300'000;
  options.run.seed = 1'000'000;
  options.plan.right_share = 0.25;
  app.add_option("--part", options.part, "looks, repeats, table, splitting, plain or tree")
      ->check(CLI::IsMember({"looks", "repeats", "table", "splitting", "plain", "tree"}))
      ->capture_default_str();
  options.run.add_to(app, "looks");
  app.add_option("--real", options.plan.real_share, "share of looks over real imagery")->check(CLI::Range(0.0, 1.0));
  app.add_option("--right", options.plan.right_share, "share of windows that hold the place")
      ->check(CLI::Range(0.0, 1.0));
  app.add_option("--data", options.data, "folder of the real sets; default: $NADIR_DATA, else ../shared/data");
  app.add_option("--svg", options.plot, "draw the reliability diagram, or the tree, into this file");
  app.add_option(
      "--from", options.from,
      "stored results, not run again: looks, table: of looks (table: or of repeats, or of plain, to be added "
      "up); tree: of splitting, then of plain");
  app.add_option("--measured", options.measured, "the table that splitting draws from")->capture_default_str();
  app.add_option("--repeated", options.repeated, "the repeats that it draws from")->capture_default_str();
  app.add_option("--repetitions", options.repetitions, "of splitting, for each fault")->check(CLI::Range(2, 10'000));
  app.add_option("--flights", options.flights, "of plain, for each fault")->check(CLI::Range(1, 100'000'000));
  app.add_option("--faults", options.faults, "of splitting and plain: these alone, by their codes in the results");
  app.add_option("--particles", options.splitting.particles, "of splitting")->check(CLI::Range(10, 100'000));
  CLI11_PARSE(app, argc, argv);
  try {
    cv::setNumThreads(1);
    keep_freed_memory();
    return run(options);
  } catch (const std::exception& error) {
    std::cerr << "integrity: " << error.what() << "\n";
    return 2;
  }
}
