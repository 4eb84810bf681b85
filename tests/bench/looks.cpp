// Labelled looks, for the fit of their likelihood ratio and for judging it: frames of painted worlds and of real
// imagery, matched where their place is and where it is not.
#include <fmt/format.h>

#include <cmath>
#include <iostream>
#include <opencv2/core/utility.hpp>
#include <sstream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/platform.hpp"
#include "bench/keypoint_matcher.hpp"
#include "bench/xfeat_keypoints.hpp"
#include "likelihood_fit.hpp"
#include "look.hpp"
#include "look_detection.hpp"
#include "seeded_runs.hpp"
#include "vision/descriptor_matcher.hpp"
#include "vision/network_plugin.hpp"

using namespace nadir;
using namespace nadir::bench;

namespace {

ProbedLooks probe_all(const Looks& looks, const Grounds& grounds, const LookPlan& plan, std::uint64_t seed) {
  GroundProbe probe;
  ProbedLooks probed;
  for (const auto& [index, look] : looks) {
    if (!shows_detection(look)) continue;
    const PlaceOfLook place = place_of_look(grounds, plan, seed, index);
    if (place.ground.name != look.ground || std::abs(place.agl_m - look.agl_m) > 1) {
      throw Error({.what = "the results hold a look that is drawn differently today",
                   .expected = fmt::format("{} from {:.0f} m", place.ground.name, place.agl_m),
                   .found = fmt::format("{} from {:.0f} m", look.ground, look.agl_m),
                   .fix = "take the looks again"});
    }
    const ProbedLook result = probe.probe(look, place);
    if (result.place.valid >= kMinValidShare) probed[index] = result;  // else the map does not show the place
  }
  return probed;
}

// Looks at which the channels found a chance peak that spoke for itself, ln Λ of 0 or more: the rare ones, by which a
// witness is worth most. Known from the stored looks that the channels' table was fitted to.
std::vector<std::uint64_t> doubtful_chance_peaks(const std::filesystem::path& store, const LookPlan& plan,
                                                 std::uint64_t seed) {
  const TrainingSet set = unpacked(read_text_file(store), store.string());
  const std::string drawn =
      fmt::format("base seed {}, {:g} real, {:g} right,", seed, plan.real_share, plan.right_share);
  std::istringstream parts(set.origin);
  std::size_t first = 0;
  for (std::string part; std::getline(parts, part, '|');) {
    const std::size_t count = std::stoul(part);
    if (part.find(drawn) == std::string::npos) {
      first += count;
      continue;
    }
    std::vector<std::uint64_t> indices;
    for (std::size_t i = 0; i < count; ++i) {
      const TrainingLook& look = set.looks.at(first + i);
      if (look.candidate && !look.right && log_likelihood_ratio(look.features, look_likelihood_table()) >= 0) {
        indices.push_back(i);
      }
    }
    return indices;
  }
  throw UsageError({.what = "no stored looks were drawn so",
                    .where = store.string(),
                    .expected = set.origin,
                    .found = drawn,
                    .fix = "pass --seed, --real and --right of a part of it"});
}

MapMatcherFactory matcher_of(std::string& name, const DescriptorMatching& how) {
  if (name == "channels") return make_channel_matcher;
  if (name == "sift") return make_sift_matcher;
  static constexpr std::string_view kKeypoints = "keypoints:";
  if (name.starts_with(kKeypoints)) {
    const std::filesystem::path model = name.substr(kKeypoints.size());
    name = "keypoints " + model.filename().string();
    return [backend = make_xfeat_keypoints(model, plugin_folders())](const MatcherMap& map) {
      return make_keypoint_matcher(map, backend);
    };
  }
  const std::filesystem::path model = name;
  const auto open = [model] { return open_network({model, std::nullopt}, plugin_folders()); };
  const OpenedNetwork opened = open();
  std::cerr << fmt::format("looks: {} by {}\n", opened.network->name(), opened.runtime);
  name = opened.network->name();
  return [open, how](const MatcherMap& map) {
    thread_local const OpenedNetwork own = open();  // a network answers one call at a time
    return make_descriptor_matcher(map, own.network, how);
  };
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Labelled looks at the map: features of the match, and whether it is right.", "looks");
  RunOptions options;
  options.count = 2000;
  options.add_to(app, "looks");
  LookPlan plan;
  app.add_option("--real", plan.real_share, "share of looks over real imagery")->check(CLI::Range(0.0, 1.0));
  app.add_option("--right", plan.right_share, "share of windows that hold the place")->check(CLI::Range(0.0, 1.0));
  app.add_option(
      "--matcher", plan.matcher_name,
      "channels, sift, the ONNX file of a descriptor network, or keypoints: and that of XFeat; the results name "
      "it and hold the places");
  DescriptorMatching how;
  app.add_option("--frame-px", how.frame_px, "of a descriptor network: a frame's longer side")->capture_default_str();
  app.add_option("--principal", how.principal_channels, "of a descriptor network: channels that are correlated")
      ->capture_default_str();
  std::filesystem::path stored;
  app.add_option(
      "--chance-peaks-of", stored,
      "only looks at which the stored ones (tests/estimation/data/looks.bin) have a chance peak of ln Λ >= 0");
  std::filesystem::path data = data_folder();
  app.add_option("--data", data, "folder of the real sets; default: $NADIR_DATA, else ../shared/data");
  std::filesystem::path probes;
  app.add_option("--matchability", probes,
                 "probe the ground of the clear looks in their place, write it to this CSV file, and print how often "
                 "each class finds its place");
  std::vector<double> odds;
  app.add_option("--odds", odds, "with --matchability: factors for good, weak and poor; default: fitted to these looks")
      ->expected(3);
  CLI11_PARSE(app, argc, argv);
  try {
    cv::setNumThreads(1);
    keep_freed_memory();
    if (!plan.matcher_name.empty()) plan.matcher = matcher_of(plan.matcher_name, how);
    const Purpose purpose = purpose_of(options.seed);
    const Grounds grounds(purpose, options.worlds, first_world(purpose), data);
    if (grounds.real().empty()) std::cerr << "looks: no real imagery: set NADIR_DATA or --data\n";
    std::vector<std::uint64_t> chosen;
    if (!stored.empty()) chosen = doubtful_chance_peaks(stored, plan, options.seed);
    const Looks looks = run_all<Look>(
        options, look_header(options.seed, plan, grounds), look_of,
        [&](std::uint64_t i) { return take_look(grounds, plan, options.seed, i); }, chosen);
    std::map<std::string, std::array<int, 3>> counts;  // all, with a candidate, right
    for (const auto& [index, look] : looks) {
      auto& [all, candidates, right] = counts[look.window + ", " + look.picture];
      ++all, candidates += look.candidate() ? 1 : 0, right += look.right() ? 1 : 0;
    }
    std::cout << "| window, picture | looks | candidates | right |\n|---|---|---|---|\n";
    for (const auto& [name, count] : counts) {
      std::cout << fmt::format("| {} | {} | {} | {} |\n", name, count[0], count[1], count[2]);
    }
    if (!probes.empty()) {
      const ProbedLooks probed = probe_all(looks, grounds, plan, options.seed);
      write_file_atomic(probes, probed_csv(probed));
      std::cout << "\n"
                << detection_tables(probed,
                                    odds.empty() ? fitted_odds(probed) : DetectionOdds{odds[0], odds[1], odds[2]});
    }
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "looks: " << error.what() << "\n";
    return 2;
  }
}
