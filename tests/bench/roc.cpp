// The knock-out test: frames matched in windows that hold their place and in windows that do not, where every
// acceptance is false by definition. docs/safety.md argues the gates' thresholds from it.
#include <iostream>
#include <opencv2/core/utility.hpp>

#include "base/files.hpp"
#include "base/platform.hpp"
#include "roc_table.hpp"
#include "seeded_runs.hpp"

using namespace nadir;
using namespace nadir::bench;

int main(int argc, char** argv) {
  CLI::App app("What thresholds accept of correct and of wrong matches.", "roc");
  RunOptions options;
  options.count = 2000;
  options.add_to(app, "trials");
  std::filesystem::path plot;
  app.add_option("--svg", plot, "draw the curves into this file");
  CLI11_PARSE(app, argc, argv);
  try {
    cv::setNumThreads(1);
    keep_freed_memory();
    const Worlds worlds(options.count == 0 ? 0 : options.worlds);  // none only to print the tables
    const Photographer photographer(camera_file().camera);
    const Trials trials =
        run_all<Trial>(options, trial_header(options.seed, options.worlds), trial_of,
                       [&](std::uint64_t i) { return try_match(worlds, photographer, options.seed, i); });
    std::cout << tables(trials);
    if (!plot.empty()) write_file_atomic(plot, roc_svg(trials));
    const Shares gates = shares_if(trials, [](const Trial& t) { return t.accepted(); });
    return gates.wrong_count == 0 ? 0 : 1;
  } catch (const std::exception& error) {
    std::cerr << "roc: " << error.what() << "\n";
    return 2;
  }
}
