#include "datasets/retrieval_datasets.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>

#include "base/csv.hpp"
#include "base/error.hpp"
#include "base/quantile.hpp"
#include "datasets/place_gallery.hpp"
#include "geodesy/local_frame.hpp"
#include "imagery/frame_image.hpp"
#include "replay/flight_folder.hpp"
#include "replay/score.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

constexpr std::ptrdiff_t kVpairTolerance = 3;  // references beside the query's own that are right as well; AnyLoc
constexpr int kLeastPicture_px = 32;

// A file named in a table, by a path beneath the dataset's folder.
fs::path picture_in(const CsvTable& table, std::size_t row, std::size_t column, const fs::path& folder) {
  const fs::path name = table.cell(row, column);
  if (name.empty() || name.is_absolute() || std::find(name.begin(), name.end(), "..") != name.end()) {
    throw Error({.what = "a cell of the dataset names no file beneath its folder",
                 .where = table.where(row, column),
                 .expected = "a file beneath " + folder.string(),
                 .found = fmt::format("\"{}\"", name.string())});
  }
  if (!fs::is_regular_file(folder / name)) {
    throw Error({.what = "a picture of the dataset is missing",
                 .where = table.where(row, column),
                 .expected = (folder / name).string(),
                 .found = "no such file",
                 .fix = "unpack the dataset completely, or remove the row"});
  }
  return folder / name;
}

std::vector<std::size_t> evenly(std::size_t count, const RetrievalOptions& options) {
  const std::size_t most = std::min(count, options.max_frames.value_or(count));
  std::vector<std::size_t> chosen;
  for (std::size_t i = 0; i < most; ++i) chosen.push_back(i * count / most);
  return chosen;
}

std::vector<RetrievalPicture> ecef_pictures(const CsvTable& table, const fs::path& folder) {
  const std::size_t file = table.required_column("filepath"), x = table.required_column("x"),
                    y = table.required_column("y"), z = table.required_column("z");
  std::vector<RetrievalPicture> pictures;
  for (std::size_t row = 0; row < table.rows(); ++row) {
    const Eigen::Vector3d at(table.required_number(row, x), table.required_number(row, y),
                             table.required_number(row, z));
    constexpr double kEarth_m = 6.3e6, kHighest_m = 6.5e6;
    if (at.norm() < kEarth_m || at.norm() > kHighest_m) {
      throw Error({.what = "a position of the dataset is not on the Earth",
                   .where = table.where(row, x),
                   .expected = "x, y and z in metres, Earth-centred, Earth-fixed",
                   .found = fmt::format("{:.0f} m from the Earth's centre", at.norm())});
    }
    pictures.push_back({picture_in(table, row, file, folder), at});
  }
  return pictures;
}

void select_queries(RetrievalDataset& dataset, const RetrievalOptions& options) {
  std::vector<RetrievalPicture> queries;
  std::vector<std::vector<std::size_t>> right;
  for (const std::size_t i : evenly(dataset.queries.size(), options)) {
    queries.push_back(std::move(dataset.queries[i]));
    right.push_back(std::move(dataset.right[i]));
  }
  dataset.queries = std::move(queries);
  dataset.right = std::move(right);
}

[[noreturn]] void fail_folder(const fs::path& folder, std::string_view dataset, std::string expected) {
  throw UsageError({.what = fmt::format("this is no folder of {}", dataset),
                    .where = folder.string(),
                    .expected = std::move(expected),
                    .found = fs::exists(folder) ? "none of it" : "nothing"});
}

std::optional<std::size_t> only(const std::map<std::string, std::size_t>& by_name, const std::string& name) {
  const auto found = by_name.find(name);
  return found == by_name.end() ? std::nullopt : std::optional(found->second);
}

PlacePatch whole_picture(const fs::path& file, int side_px) {
  const cv::Mat grey = read_grey_image(file);
  if (grey.empty() || std::min(grey.cols, grey.rows) < kLeastPicture_px) return {};
  const int side = std::min(grey.cols, grey.rows);
  const cv::Mat middle = grey(cv::Rect((grey.cols - side) / 2, (grey.rows - side) / 2, side, side));
  PlacePatch patch;
  cv::resize(middle, patch.grey, {side_px, side_px}, 0, 0, cv::INTER_AREA);
  patch.mask = cv::Mat(patch.grey.size(), CV_8UC1, cv::Scalar(255));
  return patch;
}

}  // namespace

RetrievalDataset read_vpair(const fs::path& folder, const RetrievalOptions& options) {
  RetrievalDataset dataset;
  if (fs::is_regular_file(folder / "poses_query.txt")) {
    dataset.queries = ecef_pictures(CsvTable::read(folder / "poses_query.txt"), folder);
    dataset.references = ecef_pictures(CsvTable::read(folder / "poses_reference_view.txt"), folder);
  } else if (fs::is_regular_file(folder / "poses.csv")) {
    const CsvTable table = CsvTable::read(folder / "poses.csv");
    const std::size_t file = table.required_column("filename"), lat = table.required_column("lat"),
                      lon = table.required_column("lon"), altitude = table.required_column("altitude");
    std::optional<LocalFrame> frame;
    for (std::size_t row = 0; row < table.rows(); ++row) {
      const LonLat at{table.required_number(row, lon), table.required_number(row, lat)};
      if (!frame) frame.emplace(at);
      const PlanePoint plane = frame->plane_from_lonlat(at);
      const Eigen::Vector3d position(plane.east_m, plane.north_m, table.required_number(row, altitude));
      dataset.queries.push_back({picture_in(table, row, file, folder / "queries"), position});
      dataset.references.push_back({picture_in(table, row, file, folder / "reference_views"), position});
    }
  } else {
    fail_folder(folder, "VPAIR", "poses_query.txt and poses_reference_view.txt, or poses.csv");
  }
  if (dataset.references.size() != dataset.queries.size()) {
    throw Error({.what = "VPAIR has one reference for each query, in the same order",
                 .where = (folder / "poses_reference_view.txt").string(),
                 .expected = fmt::format("{} rows", dataset.queries.size()),
                 .found = fmt::format("{}", dataset.references.size())});
  }
  const auto last = static_cast<std::ptrdiff_t>(dataset.references.size()) - 1;
  for (std::ptrdiff_t i = 0; i <= last; ++i) {
    std::vector<std::size_t>& right = dataset.right.emplace_back();
    for (std::ptrdiff_t k = std::max<std::ptrdiff_t>(0, i - kVpairTolerance); k <= std::min(last, i + kVpairTolerance);
         ++k) {
      right.push_back(static_cast<std::size_t>(k));
    }
  }
  if (fs::is_directory(folder / "distractors")) {
    std::vector<fs::path> files;
    for (const auto& entry : fs::recursive_directory_iterator(folder / "distractors")) {
      if (entry.is_regular_file() && has_frame_extension(entry.path())) files.push_back(entry.path());
    }
    std::sort(files.begin(), files.end());
    for (const fs::path& file : files) dataset.references.push_back({file, std::nullopt});
  }
  select_queries(dataset, options);
  return dataset;
}

RetrievalDataset read_alto(const fs::path& given, const RetrievalOptions& options) {
  const fs::path folder = fs::is_regular_file(given / "query.csv") ? given : given / "Val";
  if (!fs::is_regular_file(folder / "query.csv")) {
    fail_folder(given, "ALTO", "query.csv, reference.csv and gt_matches.csv, here or in Val/");
  }
  RetrievalDataset dataset;
  std::map<std::string, std::size_t> queries, references;
  const auto read = [&](const char* name, const fs::path& pictures, std::vector<RetrievalPicture>& into,
                        std::map<std::string, std::size_t>& by_name) {
    const CsvTable table = CsvTable::read(folder / name);
    const std::size_t file = table.required_column("name"), east = table.required_column("easting"),
                      north = table.required_column("northing");
    for (std::size_t row = 0; row < table.rows(); ++row) {
      const Eigen::Vector3d at(table.required_number(row, east), table.required_number(row, north), 0);
      // Some tables name the folder of the pictures, others leave it out.
      const bool whole = table.cell(row, file).starts_with(pictures.string() + "/");
      const fs::path path = picture_in(table, row, file, whole ? folder : folder / pictures);
      const auto [other, fresh] = by_name.emplace(fs::relative(path, folder / pictures).string(), into.size());
      if (!fresh) {
        throw Error({.what = "a picture of the dataset has two rows",
                     .where = table.where(row, file),
                     .found = table.cell(row, file)});
      }
      into.push_back({path, at});
    }
  };
  read("query.csv", "query_images", dataset.queries, queries);
  read("reference.csv", "reference_images", dataset.references, references);
  dataset.right.resize(dataset.queries.size());
  const CsvTable matches = CsvTable::read(folder / "gt_matches.csv");
  const std::size_t query_column = matches.required_column("query_name"),
                    reference_column = matches.required_column("ref_name");
  for (std::size_t row = 0; row < matches.rows(); ++row) {
    const auto named = [&](std::size_t column, const std::map<std::string, std::size_t>& by_name,
                           std::string_view prefix) {
      std::string name = matches.cell(row, column);
      if (name.starts_with(prefix)) name.erase(0, prefix.size());
      const auto index = only(by_name, name);
      if (index) return *index;
      throw Error({.what = "a match of the dataset names a picture that is in none of its tables",
                   .where = matches.where(row, column),
                   .expected = "a name of query.csv or reference.csv",
                   .found = fmt::format("\"{}\"", matches.cell(row, column))});
    };
    const std::size_t query = named(query_column, queries, "query_images/");
    dataset.right[query].push_back(named(reference_column, references, "reference_images/"));
  }
  for (std::size_t i = 0; i < dataset.right.size(); ++i) {
    if (!dataset.right[i].empty()) continue;
    throw Error({.what = "a query of the dataset has no match",
                 .where = matches.path().string() + ", column query_name",
                 .expected = "a row for " + dataset.queries[i].file.filename().string(),
                 .found = "none"});
  }
  select_queries(dataset, options);
  return dataset;
}

RecallFigures retrieval_recall(const RetrievalDataset& dataset, PlaceDescriber& describer, const MonotonicMs& clock,
                               Progress& progress) {
  std::vector<PlacePatch> patches;
  progress.begin("describing references", dataset.references.size(), "pictures");
  for (const RetrievalPicture& reference : dataset.references) {
    progress.advance();
    PlacePatch patch = whole_picture(reference.file, kPlacePatch_px);
    if (patch.grey.empty()) {
      patch.grey = cv::Mat::zeros(kPlacePatch_px, kPlacePatch_px, CV_8UC1);
      patch.mask = patch.grey.clone();
    }
    patches.push_back(std::move(patch));
  }
  progress.end();
  describer.train(patches);
  const PlaceGallery gallery(describer, patches);
  RecallFigures figures;
  figures.references = dataset.references.size();
  std::vector<double> first_m;
  progress.begin("searching places", dataset.queries.size(), "pictures");
  for (std::size_t i = 0; i < dataset.queries.size(); ++i) {
    progress.advance();
    ++figures.queries;
    const PlacePatch seen = whole_picture(dataset.queries[i].file, kPlacePatch_px);
    if (seen.grey.empty()) continue;
    const std::int64_t began_ms = clock();
    const auto ranked = gallery.rank(
        {.grey = seen.grey, .mask = seen.mask, .pixels_per_px = 1, .turns_rad = all_turns()}, kRecallAt.back());
    figures.ms += static_cast<double>(clock() - began_ms);
    const auto is_right = [&](std::size_t reference) {
      return std::find(dataset.right[i].begin(), dataset.right[i].end(), reference) != dataset.right[i].end();
    };
    const auto rank = static_cast<std::size_t>(std::find_if(ranked.begin(), ranked.end(), is_right) - ranked.begin());
    for (std::size_t k = 0; k < kRecallAt.size(); ++k) {
      if (rank < ranked.size() && rank < kRecallAt[k]) ++figures.found[k];
    }
    if (!ranked.empty() && dataset.references[ranked.front()].position_m && dataset.queries[i].position_m) {
      first_m.push_back((*dataset.references[ranked.front()].position_m - *dataset.queries[i].position_m).norm());
    }
  }
  progress.end();
  if (figures.queries != 0) figures.ms /= static_cast<double>(figures.queries);
  figures.median_first_m = quantile(first_m, 0.5);
  return figures;
}

nlohmann::json json_from(const RecallFigures& figures) {
  nlohmann::json document{{"queries", figures.queries},
                          {"references", figures.references},
                          {"median_first_m", rounded(figures.median_first_m)},
                          {"ms_mean", rounded(figures.ms)}};
  for (std::size_t i = 0; i < kRecallAt.size(); ++i) {
    document[fmt::format("recall_at_{}", kRecallAt[i])] = rounded(figures.recall(i));
  }
  return document;
}

Figures table_of(const RecallFigures& figures) {
  Figures table{{"retrieval", fmt::format("{} among {}", count(figures.queries, "query", "queries"),
                                          count(figures.references, "reference"))}};
  for (std::size_t i = 0; i < kRecallAt.size(); ++i) {
    table.emplace_back(fmt::format("recall at {}", kRecallAt[i]), fmt::format("{:.1f} %", 100 * figures.recall(i)));
  }
  table.emplace_back("first result", fmt::format("median {:.0f} m from the truth", figures.median_first_m));
  table.emplace_back("time of a query", fmt::format("{:.0f} ms", figures.ms));
  return table;
}

}  // namespace nadir
