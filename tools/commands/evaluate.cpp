// `nadir evaluate`: a published dataset, localized on its own map, and its own metrics.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <thread>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/platform.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "commands/scratch_folder.hpp"
#include "datasets/map_datasets.hpp"
#include "datasets/place_gallery.hpp"
#include "datasets/placement.hpp"
#include "datasets/retrieval_datasets.hpp"
#include "planning/raster_tiles.hpp"

namespace nadir {
namespace {

constexpr double kLeastSearch_m = 20, kWidestSearch_m = 1200;

class EvaluateCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "evaluate"; }
  std::string_view summary() const override { return "localize a published dataset, and say how well"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  bool has_map() const { return dataset_ != "vpair" && dataset_ != "alto"; }
  void check() const;
  int evaluate_retrieval(Context& context) const;
  int evaluate_placement(Context& context) const;
  std::vector<DatasetFlight> read_flights(const std::filesystem::path& work) const;

  std::string dataset_, method_{"frames"}, reference_{"aerial"};
  std::filesystem::path path_;
  std::optional<std::filesystem::path> camera_, out_;
  std::vector<std::string> flights_;
  std::optional<int> max_frames_, threads_;
  double search_m_ = 100, ground_m_ = 0;
  std::uint64_t seed_ = 1;
  bool recall_ = false;
};

std::string_view EvaluateCommand::details() const {
  return R"(Reads a published dataset as its authors distribute it, and localizes its pictures on its own map:
every frame by itself in a square around its true position (--search-m), or with --method flight all
of them in order, as the aircraft would. Printed are the shares within 5, 20 and 50 m, the errors and
the time of a frame; with --recall how often place retrieval finds the place on the whole map.

vpair and alto have no map, but a reference picture for every place: their metric is recall.

Nothing is trained or tuned, and the true positions are used for scoring, for the middle of the
square, and for the start of a flight. What each format leaves open is in the documentation.

Exit codes: 0 evaluated, 1 no frame was localized, 2 the dataset cannot be read.)";
}

std::string_view EvaluateCommand::examples() const {
  return R"(nadir evaluate UAV-VisLoc --dataset uav-visloc --flight 03 --camera camera03.yaml --max-frames 50
nadir evaluate AnyVisLoc --dataset anyvisloc --reference satellite --json
nadir evaluate vpair_sample --dataset vpair)";
}

void EvaluateCommand::setup(Options& options) {
  options.positional("PATH", path_, "folder of the dataset").required();
  options.value("--dataset", dataset_, "NAME", "its format")
      .one_of({"uav-visloc", "vpair", "alto", "wildnav", "anyvisloc"})
      .required();
  options.value("--camera", camera_, "FILE.yaml", "camera of the pictures; uav-visloc and wildnav state none");
  options.values("--flight", flights_, "NAME", "only these flights or scenes");
  options.value("--max-frames", max_frames_, "N", "of each flight: evenly chosen; with --method flight the first ones")
      .between(1, 1'000'000);
  options.value("--method", method_, "NAME", "every frame by itself, or a flight").one_of({"frames", "flight"});
  options.value("--search-m", search_m_, "M", "half side of the searched square")
      .between(kLeastSearch_m, kWidestSearch_m);
  options.value("--seed", seed_, "N", "of the squares' middles");
  options.value("--ground-m", ground_m_, "M", "uav-visloc: height of the ground, where heights are above the sea")
      .between(-500, 9000);
  options.value("--reference", reference_, "NAME", "anyvisloc: which of its maps").one_of({"aerial", "satellite"});
  options.flag("--recall", recall_, "place retrieval over the whole map as well");
  options.value("--threads", threads_, "N", "for --recall; default: one per processor").between(1, 256);
  options.value("--out", out_, "FILE.csv", "each frame: verdict, position, error, evidence, time");
}

void EvaluateCommand::check() const {
  const auto refuse = [this](const char* option) {
    throw UsageError({.what = fmt::format("{} is not an option of {}", option, dataset_), .fix = "leave it out"});
  };
  if (!has_map()) {
    if (camera_) refuse("--camera");
    if (!flights_.empty()) refuse("--flight");
    if (method_ == "flight") refuse("--method flight");
    if (out_) refuse("--out");
  }
  if (ground_m_ != 0 && dataset_ != "uav-visloc") refuse("--ground-m");
  if (reference_ != "aerial" && dataset_ != "anyvisloc") refuse("--reference");
  if (camera_ && dataset_ == "anyvisloc") refuse("--camera");
}

int EvaluateCommand::evaluate_retrieval(Context& context) const {
  const RetrievalOptions options{max_frames_ ? std::optional<std::size_t>(*max_frames_) : std::nullopt};
  const RetrievalDataset dataset = dataset_ == "vpair" ? read_vpair(path_, options) : read_alto(path_, options);
  const auto describer = make_gradient_describer();
  const RecallFigures figures = retrieval_recall(dataset, *describer, steady_clock_ms, context.progress);
  if (context.json) {
    nlohmann::json document = json_from(figures);
    document["dataset"] = dataset_;
    document["descriptor"] = describer->name();
    print_json(context.out, document);
  } else {
    print_figures(context.out, table_of(figures));
  }
  return figures.found.back() == 0 ? kRefused : kAccepted;
}

std::vector<DatasetFlight> EvaluateCommand::read_flights(const std::filesystem::path& work) const {
  const MapDatasetOptions options{.camera = camera_,
                                  .flights = flights_,
                                  .max_frames = max_frames_ ? std::optional<std::size_t>(*max_frames_) : std::nullopt,
                                  .in_sequence = method_ == "flight",
                                  .ground_m = ground_m_,
                                  .reference = reference_,
                                  .work = work};
  if (dataset_ == "uav-visloc") return read_uav_visloc(path_, options);
  if (dataset_ == "wildnav") return read_wildnav(path_, options);
  return read_anyvisloc(path_, options);
}

int EvaluateCommand::evaluate_placement(Context& context) const {
  const ScratchFolder scratch("nadir-evaluate");
  const PlacementOptions options{.search_m = search_m_, .seed = seed_};
  const int threads = threads_.value_or(static_cast<int>(std::max(1U, std::thread::hardware_concurrency())));
  std::vector<PlacedFrame> all;
  std::map<std::string, std::vector<PlacedFrame>> by_flight;
  nlohmann::json recalls = nlohmann::json::object();
  std::vector<std::pair<std::string, MapRecall>> recalled;
  const std::vector<DatasetFlight> flights = read_flights(scratch.path());
  for (auto first = flights.begin(); first != flights.end();) {
    // Flights of one scene, which differ by their cameras, share its map.
    const auto last = std::find_if(first, flights.end(), [&](const auto& one) { return one.map != first->map; });
    const RasterTiles tiles(first->map);
    std::vector<PlacedFrame>& of_scene = by_flight[first->name];
    for (auto flight = first; flight != last; ++flight) {
      const auto placed = method_ == "flight" ? place_flight(*flight, tiles, context.progress)
                                              : place_frames(*flight, tiles, options, context.progress);
      of_scene.insert(of_scene.end(), placed.begin(), placed.end());
      all.insert(all.end(), placed.begin(), placed.end());
    }
    if (recall_) {
      const MapRecall recall = map_recall({first, last}, tiles, options, threads, context.progress);
      recalls[first->name] = {{"chunks", recall.chunks},
                              {"left_out", recall.of_frames.left_out},
                              {"heading_known", json_from(recall.of_frames.known)},
                              {"heading_unknown", json_from(recall.of_frames.unknown)}};
      recalled.emplace_back(first->name, recall);
    }
    first = last;
  }
  if (out_) write_file_atomic(*out_, csv_of(all));
  const PlacementFigures figures = figures_of(all);
  if (context.json) {
    nlohmann::json document{{"dataset", dataset_}, {"method", method_}, {"all", json_from(figures)}};
    if (method_ == "frames") document["search_m"] = search_m_;
    for (const auto& [name, frames] : by_flight) document["flights"][name] = json_from(figures_of(frames));
    if (recall_) document["recall"] = recalls;
    print_json(context.out, document);
  } else {
    for (const auto& [name, frames] : by_flight) {
      if (by_flight.size() == 1) break;
      context.out << name << '\n';
      print_figures(context.out, table_of(figures_of(frames)));
    }
    if (by_flight.size() > 1) context.out << "all\n";
    print_figures(context.out, table_of(figures));
    for (const auto& [name, recall] : recalled) {
      if (recalled.size() > 1) context.out << name << '\n';
      print_figures(context.out, {{"place retrieval", fmt::format("{} of the map", count(recall.chunks, "chunk"))},
                                  {"heading known to ±15°", text_from(recall.of_frames.known)},
                                  {"heading unknown", text_from(recall.of_frames.unknown)}});
    }
  }
  return figures.accepted == 0 ? kRefused : kAccepted;
}

int EvaluateCommand::run(Context& context) {
  keep_freed_memory();
  check();
  return has_map() ? evaluate_placement(context) : evaluate_retrieval(context);
}

}  // namespace

std::unique_ptr<Command> make_evaluate() { return std::make_unique<EvaluateCommand>(); }

}  // namespace nadir
