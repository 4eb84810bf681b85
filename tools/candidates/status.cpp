#include "candidates/status.hpp"

#include <nlohmann/json.hpp>
#include <ostream>

#include "candidates/candidate_catalogue.hpp"
#include "candidates/catalogue_option.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"

namespace nadir {

void StatusCommand::setup(Options& options) {
  options.value("--data", data_, "DIR", "the service's folder");
  options.value("--catalogue", catalogue_, "CATALOGUE", "where it is not DATA/catalogue.sqlite");
}

int StatusCommand::run(Context& context) {
  CandidateCatalogue catalogue(catalogue_location(catalogue_, data_), CandidateCatalogue::Access::read);
  const CatalogueCounts counts = catalogue.counts();
  if (context.json) {
    nlohmann::json rejected = nlohmann::json::object();
    for (const auto& [code, tiles] : counts.rejected_by) rejected[code] = tiles;
    print_json(context.out, {{"uploads", {{"all", counts.uploads}, {"open", counts.open}, {"judging", counts.judging}}},
                             {"tiles",
                              {{"announced", counts.tiles},
                               {"accepted", counts.accepted},
                               {"rejected", counts.rejected},
                               {"duplicate", counts.duplicate},
                               {"to_vote", counts.to_vote},
                               {"promoted", counts.promoted}}},
                             {"rejected", std::move(rejected)}});
    return kAccepted;
  }
  Figures figures{{"uploads", std::to_string(counts.uploads)},        {"  open", std::to_string(counts.open)},
                  {"  being judged", std::to_string(counts.judging)}, {"tiles announced", std::to_string(counts.tiles)},
                  {"  accepted", std::to_string(counts.accepted)},    {"  duplicate", std::to_string(counts.duplicate)},
                  {"  rejected", std::to_string(counts.rejected)}};
  for (const auto& [code, tiles] : counts.rejected_by) figures.emplace_back("    " + code, std::to_string(tiles));
  figures.emplace_back("waiting for a vote", std::to_string(counts.to_vote));
  figures.emplace_back("promoted", std::to_string(counts.promoted));
  print_figures(context.out, figures);
  return kAccepted;
}

}  // namespace nadir
