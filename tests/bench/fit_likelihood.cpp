// Fits the likelihood ratio of a look and writes its table: from results of `./run bench looks`, which are stored
// compactly first, or from those stored before.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <iostream>
#include <sstream>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "likelihood_fit.hpp"
#include "look.hpp"

using namespace nadir;
using namespace nadir::bench;

namespace {

PictureKind kind_of(const Look& look) {
  const auto kind = std::find(kPictureKinds.begin(), kPictureKinds.end(), look.picture);
  if (kind == kPictureKinds.end()) throw Error({.what = "no kind of picture", .found = look.picture});
  return static_cast<PictureKind>(kind - kPictureKinds.begin());
}

// Of several files in the order of the command line, each by index: the same files give the same set.
TrainingSet training_set(const std::vector<std::filesystem::path>& files) {
  TrainingSet set;
  for (const std::filesystem::path& file : files) {
    const LooksFile stored = read_looks(file);
    for (const auto& [index, look] : stored.looks) {
      set.looks.push_back({look.candidate(), look.holds_place(), look.right(), kind_of(look), look.features});
    }
    set.origin += fmt::format("{}{} looks, {}, grounds: {}", set.origin.empty() ? "" : " | ", stored.looks.size(),
                              stored.run, stored.grounds);
  }
  return set;
}

void print(const LookLikelihoodTable& table, const TrainingSet& set) {
  std::cout << fmt::format("{} candidates that are the place, {} that are not; limit {:.2f}\n\n", table.true_looks,
                           table.chance_looks, table.limit);
  std::cout << "| feature | knots | weight of evidence, nats | range |\n|---|---|---|---|\n";
  const auto row = [](std::string_view name, const MonotoneCurve& curve) {
    std::string at, value;
    for (std::size_t i = 0; i < static_cast<std::size_t>(curve.knots); ++i) {
      at += fmt::format("{}{:.4g}", i == 0 ? "" : ", ", curve.at[i]);
      value += fmt::format("{}{:.2f}", i == 0 ? "" : ", ", curve.value[i]);
    }
    const double range =
        curve.knots == 0 ? 0 : std::abs(curve.value[static_cast<std::size_t>(curve.knots) - 1] - curve.value[0]);
    std::cout << fmt::format("| {} | {} | {} | {:.2f} |\n", name, at, value, range);
  };
  for (std::size_t i = 0; i < LookFeatures::kCount; ++i) row(LookFeatures::names[i], table.curves[i]);
  row("ratio x places", table.ratio_by_places);
  double above5 = 0, above8 = 0, all = 0, chance = 0, mean = 0;
  for (const TrainingLook& look : set.looks) {
    if (!look.candidate) continue;
    const double ell = log_likelihood_ratio(look.features, table);
    if (look.right) {
      ++all, above5 += ell > 5 ? 1 : 0, above8 += ell > 8 ? 1 : 0;
    } else {
      ++chance, mean += std::exp(ell);
    }
  }
  std::cout << fmt::format("\nof the true ones {:.1f} % above 5, {:.1f} % above 8; mean ratio of the others {:.3f}\n",
                           100 * above5 / all, 100 * above8 / all, mean / chance);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Fits the likelihood ratio of a look and writes its table.", "fit-likelihood");
  std::vector<std::filesystem::path> files;
  std::filesystem::path store = "tests/estimation/data/looks.bin",
                        table = "libgeo/estimation/look_likelihood_table.hpp";
  FitOptions options;
  app.add_option("--looks", files, "results of ./run bench looks: stored first, in place of those that are");
  app.add_option("--store", store, "the stored looks")->capture_default_str();
  app.add_option("--table", table, "the table, written anew")->capture_default_str();
  app.add_option("--penalty", options.penalty, "on the curves' rises")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    if (!files.empty()) write_file_atomic(store, packed(training_set(files)));
    const std::string bytes = read_text_file(store);
    const TrainingSet set = unpacked(bytes, store.string());
    const auto fitted = fit(set, sha256(as_bytes(bytes)).hex(), options);
    write_file_atomic(table, table_source(fitted->table));
    print(fitted->table, set);
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "fit-likelihood: " << error.what() << "\n";
    return 2;
  }
}
