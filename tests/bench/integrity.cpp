// Integrity, judged on what nobody fitted to. Part 1: looks that cannot be right, by the hundred thousand, and how
// often their likelihood ratio claims that they are; whether a ratio is the evidence that it states.
#include <iostream>
#include <opencv2/core/utility.hpp>

#include "base/files.hpp"
#include "base/platform.hpp"
#include "look_rates.hpp"
#include "seeded_runs.hpp"

using namespace nadir;
using namespace nadir::bench;

int main(int argc, char** argv) {
  CLI::App app("How often chance peaks pass for the place, on unseen seeds, worlds and imagery.", "integrity");
  RunOptions options;
  options.count = 300'000;
  options.seed = 1'000'000;
  options.add_to(app, "looks");
  LookPlan plan;
  plan.right_share = 0.25;
  app.add_option("--real", plan.real_share, "share of looks over real imagery")->check(CLI::Range(0.0, 1.0));
  app.add_option("--right", plan.right_share, "share of windows that hold the place")->check(CLI::Range(0.0, 1.0));
  std::filesystem::path data = data_folder(), plot;
  app.add_option("--data", data, "folder of the real sets; default: $NADIR_DATA, else ../shared/data");
  app.add_option("--svg", plot, "draw the reliability diagram into this file");
  CLI11_PARSE(app, argc, argv);
  try {
    cv::setNumThreads(1);
    keep_freed_memory();
    if (purpose_of(options.seed) != Purpose::judge) {
      std::cerr << "integrity: seeds below a million were fitted to; pass --seed 1000000 or more\n";
      return 2;
    }
    const Grounds grounds(Purpose::judge, options.worlds, first_world(Purpose::judge), data);
    if (grounds.real().empty()) std::cerr << "integrity: no real imagery: set NADIR_DATA or --data\n";
    const Looks looks = run_all<Look>(options, look_header(options.seed, plan, grounds), look_of,
                                      [&](std::uint64_t i) { return take_look(grounds, plan, options.seed, i); });
    std::cout << rate_tables(looks);
    if (!plot.empty()) write_file_atomic(plot, reliability_svg(looks));
    const std::string found = contradictions(looks);
    std::cout << "\n" << (found.empty() ? "no rate contradicts its bound\n" : found);
    return found.empty() ? 0 : 1;
  } catch (const std::exception& error) {
    std::cerr << "integrity: " << error.what() << "\n";
    return 2;
  }
}
