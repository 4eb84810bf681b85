// The knock-out test: frames matched in windows that hold their place and in windows that do not, where every
// acceptance is false by definition. The likelihood of a look is fitted to such looks (docs/integrity.md).
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
  options.add_to(app, "looks");
  std::filesystem::path plot;
  app.add_option("--svg", plot, "draw the curves into this file");
  CLI11_PARSE(app, argc, argv);
  try {
    cv::setNumThreads(1);
    keep_freed_memory();
    const Purpose purpose = purpose_of(options.seed);
    const Grounds grounds(purpose, options.worlds, first_world(purpose), {});  // painted worlds alone
    const Looks looks = run_all<Look>(options, look_header(options.seed, {}, grounds), look_of,
                                      [&](std::uint64_t i) { return take_look(grounds, {}, options.seed, i); });
    std::cout << tables(looks);
    if (!plot.empty()) write_file_atomic(plot, roc_svg(looks));
    const Shares sure = shares_if(looks, [](const Look& t) { return t.accepted(); });
    return sure.wrong_count == 0 ? 0 : 1;
  } catch (const std::exception& error) {
    std::cerr << "roc: " << error.what() << "\n";
    return 2;
  }
}
