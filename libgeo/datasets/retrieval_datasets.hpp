// Published datasets of aerial pictures without a map: pictures, and reference pictures among which the right one is to
// be found. Formats as their authors publish them:
//
//   VPAIR   https://github.com/AerVisLoc/vpair (README; arXiv:2205.11567)
//     poses_query.txt and poses_reference_view.txt: filepath, x, y, z: ECEF, metres (the sample of Zenodo 6473989); or
//       one poses.csv: filename, lat, lon, altitude: degrees and metres (the whole set)
//     queries/, reference_views/: the picture and its reference, rendered from the same pose; distractors/ of other
//       ground, which count as references that are never right
//     Right: a reference at most three places away in the flight, as AnyLoc counts (arXiv:2308.00688).
//   ALTO    https://github.com/MetaSLAM/ALTO, GPR Competition 2022 (README of the data; arXiv:2207.12317)
//     Val/ or Train/: query.csv: name, easting, northing (UTM 17N, metres), orient_x, orient_y, orient_z, orient_w
//     (camera
//       against ECEF); reference.csv: name, easting, northing; gt_matches.csv: query_name, ref_name
//     query_images/, reference_images/offset_*/: north up
//     Right: the reference that gt_matches.csv names.
//
// The headings of the pictures are not used: all are possible. Camera and ground sample distance are published for
// neither, so a picture is compared whole with a whole reference.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "base/monotonic.hpp"
#include "base/progress.hpp"
#include "cli/output.hpp"

namespace nadir {

class PlaceDescriber;

struct RetrievalPicture {
  std::filesystem::path file;
  std::optional<Eigen::Vector3d> position_m;  // in the dataset's metres; nothing: a distractor's
};

struct RetrievalDataset {
  std::vector<RetrievalPicture> queries, references;
  std::vector<std::vector<std::size_t>> right;  // of each query: references
};

// The values of K.
inline constexpr std::array<std::size_t, 4> kRecallAt{1, 5, 10, 20};

struct RecallFigures {
  std::size_t queries = 0, references = 0;
  std::array<std::size_t, kRecallAt.size()> found{};  // queries, by kRecallAt
  double median_first_m = 0;                          // from the truth to the first result
  double ms = 0;                                      // of a query, mean

  double recall(std::size_t at) const {
    return queries == 0 ? 0 : static_cast<double>(found[at]) / static_cast<double>(queries);
  }
};

nlohmann::json json_from(const RecallFigures& figures);
Figures table_of(const RecallFigures& figures);

struct RetrievalOptions {
  std::optional<std::size_t> max_frames;  // queries, evenly chosen; all references stay
};

RetrievalDataset read_vpair(const std::filesystem::path& folder, const RetrievalOptions& options);
RetrievalDataset read_alto(const std::filesystem::path& folder, const RetrievalOptions& options);

// Pictures that cannot be read are queries that find nothing, and references that are never found.
RecallFigures retrieval_recall(const RetrievalDataset& dataset, PlaceDescriber& describer, const MonotonicMs& clock,
                               Progress& progress);

}  // namespace nadir
