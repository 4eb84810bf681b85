#include "vision/place_index.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/random.hpp"
#include "package/open_package.hpp"
#include "package/tile_container.hpp"
#include "package/verify.hpp"

namespace nadir {
namespace {

std::vector<double> turns(const std::optional<double>& range_rad) {
  std::vector<double> result;
  if (!range_rad || *range_rad >= std::numbers::pi) {
    for (int i = 0; i < kQueryTurns; ++i) {
      result.push_back(2 * std::numbers::pi * (i > kQueryTurns / 2 ? i - kQueryTurns : i) / kQueryTurns);
    }
    return result;
  }
  const double step =
      *range_rad > kFineTurnRange * kQueryTurn_rad ? 2 * std::numbers::pi / kQueryTurns : kQueryTurn_rad;
  const int n = std::max(0, static_cast<int>(std::ceil(*range_rad / step - 0.5)));
  for (int i = -n; i <= n; ++i) result.push_back(i * step);
  return result;
}

// One description of the frame: turned, shifted.
struct Variant {
  double turn_rad = 0;
  cv::Point2d shift;  // of the patch's middle from the frame's, in sides, along the chunk's east and south
};

Bytes read_checked(const Directory& package, const Artifact& artifact, std::uint64_t max_size) {
  Bytes bytes = package.open(artifact.path).read(std::min(artifact.size, max_size));
  const Sha256 digest = sha256(bytes);
  if (digest != artifact.sha256) {
    throw Error({.what = "a file of the place index is not the signed one",
                 .where = artifact.path,
                 .expected = artifact.sha256.hex(),
                 .found = digest.hex()});
  }
  return bytes;
}

[[noreturn]] void fail_mismatch(const char* what, std::string where, std::string expected, std::string found) {
  throw Error({.what = what,
               .where = std::move(where),
               .expected = std::move(expected),
               .found = std::move(found),
               .fix = "rebuild it with `nadir cache index`"});
}

Finding mismatch_finding(std::string where, std::string expected, std::string found) {
  return {.code = "index.mismatch",
          .where = std::move(where),
          .expected = std::move(expected),
          .found = std::move(found),
          .fix = "rebuild the index with `nadir cache index`"};
}

std::vector<std::size_t> sample_of(std::size_t chunks, const Manifest& manifest) {
  const std::string bytes = manifest_json(manifest);
  const Sha256 digest = sha256(as_bytes(bytes));
  std::uint64_t seed = 0;
  for (std::size_t i = 0; i < 8; ++i) seed = seed << 8 | digest.bytes[i];
  std::vector<std::size_t> all(chunks);
  for (std::size_t i = 0; i < chunks; ++i) all[i] = i;
  const std::size_t wanted = std::min(chunks, std::max(kMinCheckedChunks, chunks / kCheckedChunksDivisor));
  Random random(seed);
  for (std::size_t i = 0; i < wanted; ++i) {  // the first steps of a shuffle
    const std::size_t left = chunks - i;
    const auto pick = static_cast<std::size_t>(random.uniform() * static_cast<double>(left));
    std::swap(all[i], all[i + std::min(pick, left - 1)]);
  }
  all.resize(wanted);
  std::sort(all.begin(), all.end());  // neighbours share tiles
  return all;
}

Findings recompute(const PlaceIndex& index, const Manifest& manifest, const TileSource& tiles, Progress& progress) {
  Findings findings;
  const PlaceTable& table = index.table();
  const std::vector<std::size_t> sample = sample_of(table.chunks.size(), manifest);
  ChunkReader reader(tiles, table.origin());
  progress.begin("recomputing place descriptors", sample.size(), "places");
  for (const std::size_t i : sample) {
    progress.advance();
    const auto layer = std::find_if(table.layers.begin(), table.layers.end(),
                                    [i](const PlaceLayer& one) { return i < one.first + one.count; });
    const std::string where = fmt::format("{} chunk {} (tile {})", kPlaceIndexFile, i, to_text(table.chunks[i].tile));
    double cosine = 0;
    try {
      const auto raw = describe_place(reader.read(*layer, table.chunks[i]));
      if (raw) {
        const PlaceVector vector = table.projection.project(*raw);
        const std::span<const float> stored = index.vectors().vector(i);
        double length = 0;
        for (std::size_t k = 0; k < kPlaceSize; ++k) {
          cosine += static_cast<double>(vector[k]) * static_cast<double>(stored[k]);
          length += static_cast<double>(stored[k]) * static_cast<double>(stored[k]);
        }
        if (!(std::abs(length - 1) < kCheckedLengthError)) cosine = 0;
      }
    } catch (const Error& error) {
      findings.add(mismatch_finding(where, "tiles that can be described", error.text().what));
      continue;
    }
    if (cosine >= kMinCheckedCosine) continue;
    if (findings.items().size() == kMaxIndexFindings) break;
    findings.add(mismatch_finding(where, "the description that its tiles give",
                                  fmt::format("another one, with a cosine of {:.3f}", cosine)));
  }
  progress.end();
  return findings;
}

bool damaged(const Findings& findings, const Artifact* artifact) {
  return artifact != nullptr &&
         std::any_of(findings.items().begin(), findings.items().end(), [artifact](const Finding& finding) {
           return finding.code.starts_with("artifact.") && finding.where == artifact->path;
         });
}

}  // namespace

PlaceIndex::PlaceIndex(PlaceTable table, PlaceVectors vectors)
    : table_(std::move(table)), vectors_(std::move(vectors)) {
  if (vectors_.size() != table_.chunks.size()) {
    fail_mismatch("the place index and its table do not belong together", std::string(kPlaceTableFile),
                  std::to_string(vectors_.size()) + " chunks", std::to_string(table_.chunks.size()));
  }
}

std::optional<PlaceIndex> PlaceIndex::open(const Directory& package, const Manifest& manifest) {
  const Artifact* vectors = manifest.artifact(kRolePlaceIndex);
  const Artifact* table = manifest.artifact(kRolePlaceTable);
  if (vectors == nullptr && table == nullptr) return std::nullopt;
  if (vectors == nullptr || table == nullptr) {
    fail_mismatch("incomplete place index", std::string(kManifestFile), "the vectors and their table",
                  vectors == nullptr ? "only the table" : "only the vectors");
  }
  const Bytes text = read_checked(package, *table, kMaxPlaceTableSize);
  PlaceTable parsed = parse_place_table(as_text(text), table->path);
  const Artifact* imagery = manifest.artifact(kRoleImagery);
  if (imagery == nullptr || !imagery->tiles || imagery->tiles->merkle_root != parsed.imagery_root) {
    fail_mismatch("the place index was built from other imagery", table->path,
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
        const Variant variant{turn, {i * kQueryShift, j * kQueryShift}};
        // If the heading were larger by `turn`, the frame would lie turned clockwise by it: what the chunk shows to its
        // east lies anticlockwise of east in the frame as it is.
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
  const auto hits = vectors_.search(vectors, layer->first, layer->count, std::max(count, kHitsPerQuery), query.cancel);
  std::vector<PlaceCandidate> best;
  for (std::size_t v = 0; v < hits.size(); ++v) {
    for (const PlaceVectors::Hit& hit : hits[v]) {
      PlaceCandidate candidate;
      candidate.chunk = hit.index;
      candidate.score = static_cast<double>(hit.score);
      candidate.turn_rad = variants[v].turn_rad;
      candidate.side_m = layer->side_m();
      candidate.offset_m = {-variants[v].shift.x * layer->side_m(), variants[v].shift.y * layer->side_m()};
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

ChunkReader::ChunkReader(const TileSource& tiles, LonLat origin) : frame_(origin), windows_(tiles) {}

MapWindow ChunkReader::around(const PlaceLayer& layer, const PlaceChunk& chunk, double sides) {
  const PlanePoint middle = frame_.plane_from_lonlat(chunk.centre());
  const double half_m = std::round(static_cast<double>(layer.side_px) * sides) * layer.gsd_m() / 2;
  return windows_.read(
      frame_, {middle.east_m - half_m, middle.north_m - half_m, middle.east_m + half_m, middle.north_m + half_m},
      layer.gsd_m(), Colour::grey);
}

PlacePatch ChunkReader::read(const PlaceLayer& layer, const PlaceChunk& chunk) {
  const MapWindow window = around(layer, chunk, 1);
  return {window.image, window.mask};
}

Findings check_place_index(const Directory& package, const Manifest& manifest, const Mission& mission,
                           const TileSource& tiles, VerifyDepth depth, Progress& progress) {
  Findings findings;
  try {
    const std::optional<PlaceIndex> index = PlaceIndex::open(package, manifest);
    if (!index) return findings;
    const LonLat origin = index->table().origin();
    if (std::abs(origin.lon_deg - mission.takeoff.lon_deg) > kSameOrigin_deg ||
        std::abs(origin.lat_deg - mission.takeoff.lat_deg) > kSameOrigin_deg) {
      findings.add(
          mismatch_finding(std::string(kPlaceTableFile), "the mission's take-off point as origin", "another place"));
      return findings;
    }
    if (depth == VerifyDepth::full) findings.add(recompute(*index, manifest, tiles, progress));
  } catch (const Error& error) {
    const ErrorText& text = error.text();
    findings.add(mismatch_finding(text.where,
                                  text.expected.empty() ? "a place index of this package's imagery" : text.expected,
                                  text.found.empty() ? text.what : text.what + ": " + text.found));
  }
  return findings;
}

void verify_place_index(VerifyDepth depth, Progress& progress, Verification& verification) {
  if (!verification.manifest || !verification.mission) return;
  const Manifest& manifest = *verification.manifest;
  const Artifact* imagery = manifest.artifact(kRoleImagery);
  for (const Artifact* artifact : {imagery, manifest.artifact(kRolePlaceIndex), manifest.artifact(kRolePlaceTable)}) {
    if (damaged(verification.findings, artifact)) return;  // its own finding is there
  }
  if (!verification.imagery || verification.tiles.empty()) return;
  const std::unique_ptr<TileSource> tiles =
      open_tile_source(verification.imagery->duplicate(), TileSetRules::of_package(verification.tiles.size()));
  verification.findings.add(
      check_place_index(*verification.folder, manifest, *verification.mission, *tiles, depth, progress));
}

void verify_place_index(VerifyDepth depth, Progress& progress, Opening& opening) {
  if (!opening.package) return;
  opening.findings.add(check_place_index(opening.package->folder(), opening.package->manifest(),
                                         opening.package->mission(), opening.package->imagery(), depth, progress));
  if (opening.findings.has_errors()) opening.package.reset();
}

}  // namespace nadir
