#include "vision/place_index.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace {

constexpr double kTurnStep_rad = std::numbers::pi / 18;  // 10 degrees, within a known range
constexpr int kTurnsUnknown = 24;
constexpr double kShift = 1.0 / 6;     // of a side
constexpr std::size_t kPerQuery = 64;  // chunks that each variant of the picture may name

std::vector<double> turns(const std::optional<double>& range_rad) {
  std::vector<double> result;
  if (!range_rad || *range_rad >= std::numbers::pi) {
    for (int i = 0; i < kTurnsUnknown; ++i) {
      result.push_back(2 * std::numbers::pi * (i > kTurnsUnknown / 2 ? i - kTurnsUnknown : i) / kTurnsUnknown);
    }
    return result;
  }
  const double step = *range_rad > 12 * kTurnStep_rad ? 2 * std::numbers::pi / kTurnsUnknown : kTurnStep_rad;
  const int n = std::max(0, static_cast<int>(std::ceil(*range_rad / step - 0.5)));
  for (int i = -n; i <= n; ++i) result.push_back(i * step);
  return result;
}

// One description of the picture: turned, shifted.
struct Variant {
  double turn_rad = 0;
  cv::Point2d shift;  // of the patch's middle from the picture's, in sides, along the chunk's east and south
};

Bytes read_checked(const std::filesystem::path& package, const Artifact& artifact, std::uint64_t max_size) {
  const std::filesystem::path path = package / artifact.path;
  Bytes bytes = read_file(path, std::min(artifact.size, max_size));
  const Sha256 digest = sha256(bytes);
  if (digest != artifact.sha256) {
    throw Error({.what = "a file of the place index is not the one that was signed",
                 .where = path,
                 .expected = artifact.sha256.hex(),
                 .found = digest.hex()});
  }
  return bytes;
}

[[noreturn]] void mismatch(const char* what, std::string where, std::string expected, std::string found) {
  throw Error({.what = what,
               .where = std::move(where),
               .expected = std::move(expected),
               .found = std::move(found),
               .fix = "make it again with `nadir cache index`"});
}

}  // namespace

PlaceIndex::PlaceIndex(PlaceTable table, PlaceVectors vectors)
    : table_(std::move(table)), vectors_(std::move(vectors)) {
  if (vectors_.size() != table_.chunks.size()) {
    mismatch("the place index and its table do not belong together", std::string(kPlaceTableFile),
             std::to_string(vectors_.size()) + " chunks", std::to_string(table_.chunks.size()));
  }
}

std::optional<PlaceIndex> PlaceIndex::open(const std::filesystem::path& package, const Manifest& manifest) {
  const Artifact* vectors = manifest.artifact(kRolePlaceIndex);
  const Artifact* table = manifest.artifact(kRolePlaceTable);
  if (vectors == nullptr && table == nullptr) return std::nullopt;
  if (vectors == nullptr || table == nullptr) {
    mismatch("half of a place index", std::string(kManifestFile), "the vectors and their table",
             vectors == nullptr ? "the table alone" : "the vectors alone");
  }
  const Bytes text = read_checked(package, *table, kMaxPlaceTableSize);
  PlaceTable parsed = parse_place_table(as_text(text), table->path);
  const Artifact* imagery = manifest.artifact(kRoleImagery);
  if (imagery == nullptr || !imagery->tiles || imagery->tiles->merkle_root != parsed.imagery_root) {
    mismatch("the place index was made of other imagery", table->path,
             imagery != nullptr && imagery->tiles ? imagery->tiles->merkle_root.hex() : "imagery",
             parsed.imagery_root.hex());
  }
  const Bytes file = read_checked(package, *vectors, std::uint64_t{1} << 30);
  PlaceVectors read(file, parsed.chunks.size(), vectors->path);
  return PlaceIndex(std::move(parsed), std::move(read));
}

const PlaceLayer* PlaceIndex::layer_for(double side_m) const {
  const PlaceLayer* nearest = nullptr;
  double least = std::numeric_limits<double>::infinity();
  for (const PlaceLayer& layer : table_.layers) {
    const double off = std::abs(std::log(layer.side_m() / side_m));
    if (layer.count != 0 && off < least) nearest = &layer, least = off;
  }
  return nearest;
}

std::vector<PlaceCandidate> PlaceIndex::query(const PlaceQuery& query, std::size_t count) const {
  const double seen_m = std::sqrt(static_cast<double>(cv::countNonZero(query.mask))) * query.gsd_m;
  const PlaceLayer* layer = seen_m > 0 ? layer_for(seen_m) : nullptr;
  if (layer == nullptr) return {};
  const double step = layer->gsd_m() / query.gsd_m;
  const PatchCutter cutter(query.grey, query.mask, step);
  const int side_px = static_cast<int>(layer->side_px);

  std::vector<Variant> variants;
  std::vector<PlaceVector> vectors;
  for (const double turn : turns(query.heading_range_rad)) {
    query.cancel.check();
    for (int i = -1; i <= 1; ++i) {
      for (int j = -1; j <= 1; ++j) {
        const Variant variant{turn, {i * kShift, j * kShift}};
        // Were the heading larger by `turn`, the picture would lie turned clockwise by it: what the chunk shows to its
        // east lies anticlockwise of east in the picture as it is.
        const PlacePatch patch = cutter.cut({.centre = {query.grey.cols / 2.0, query.grey.rows / 2.0},
                                             .turn_rad = -turn,
                                             .pixels_per_px = step,
                                             .shift_px = variant.shift * side_px,
                                             .side_px = side_px});
        const auto raw = describe_place(patch);
        if (!raw) continue;
        variants.push_back(variant);
        vectors.push_back(table_.projection.project(*raw));
      }
    }
  }
  const auto hits = vectors_.search(vectors, layer->first, layer->count, std::max(count, kPerQuery), query.cancel);
  std::vector<PlaceCandidate> best;
  for (std::size_t v = 0; v < hits.size(); ++v) {
    for (const PlaceVectors::Hit& hit : hits[v]) {
      PlaceCandidate candidate;
      candidate.chunk = hit.index;
      candidate.score = static_cast<double>(hit.score);
      candidate.turn_rad = variants[v].turn_rad;
      candidate.side_m = layer->side_m();
      candidate.east_m = -variants[v].shift.x * layer->side_m();
      candidate.north_m = variants[v].shift.y * layer->side_m();
      best.push_back(candidate);
    }
  }
  // Each chunk once, by its best variant; equal scores by number, so that the order is always the same.
  std::stable_sort(best.begin(), best.end(), [](const PlaceCandidate& a, const PlaceCandidate& b) {
    return a.chunk != b.chunk ? a.chunk < b.chunk : a.score > b.score;
  });
  best.erase(std::unique(best.begin(), best.end(),
                         [](const PlaceCandidate& a, const PlaceCandidate& b) { return a.chunk == b.chunk; }),
             best.end());
  std::stable_sort(best.begin(), best.end(),
                   [](const PlaceCandidate& a, const PlaceCandidate& b) { return a.score > b.score; });
  if (best.size() > count) best.resize(count);
  for (PlaceCandidate& candidate : best) candidate.centre = table_.chunks[candidate.chunk].centre();
  return best;
}

}  // namespace nadir
