#include "vision/place_index_check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/error.hpp"
#include "base/random.hpp"
#include "package/tile_container.hpp"
#include "vision/place_index_builder.hpp"

namespace nadir {
namespace {

constexpr std::size_t kMinSample = 32;
constexpr double kMinLikeness = 0.999;  // other processors round differently
constexpr std::size_t kMaxFindings = 20;

Finding mismatch(std::string where, std::string expected, std::string found) {
  return {.code = "index.mismatch",
          .where = std::move(where),
          .expected = std::move(expected),
          .found = std::move(found),
          .fix = "make the index again with `nadir cache index`"};
}

std::vector<std::size_t> sample_of(std::size_t chunks, const Manifest& manifest) {
  const std::string bytes = manifest_json(manifest);
  const Sha256 digest = sha256(as_bytes(bytes));
  std::uint64_t seed = 0;
  for (std::size_t i = 0; i < 8; ++i) seed = seed << 8 | digest.bytes[i];
  std::vector<std::size_t> all(chunks);
  for (std::size_t i = 0; i < chunks; ++i) all[i] = i;
  const std::size_t wanted = std::min(chunks, std::max(kMinSample, chunks / 100));
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
  progress.begin("describing places again", sample.size(), "places");
  for (const std::size_t i : sample) {
    progress.advance();
    const auto layer = std::find_if(table.layers.begin(), table.layers.end(),
                                    [i](const PlaceLayer& one) { return i < one.first + one.count; });
    const std::string where = fmt::format("{} chunk {} (tile {})", kPlaceIndexFile, i, to_text(table.chunks[i].tile));
    double likeness = 0;
    try {
      const auto raw = describe_place(reader.read(*layer, table.chunks[i]));
      if (raw) {
        const PlaceVector vector = table.projection.project(*raw);
        const std::span<const float> stored = index.vectors().vector(i);
        double length = 0;
        for (std::size_t k = 0; k < kPlaceSize; ++k) {
          likeness += static_cast<double>(vector[k]) * static_cast<double>(stored[k]);
          length += static_cast<double>(stored[k]) * static_cast<double>(stored[k]);
        }
        if (!(std::abs(length - 1) < 0.01)) likeness = 0;
      }
    } catch (const Error& error) {
      findings.add(mismatch(where, "tiles that can be described", error.text().what));
      continue;
    }
    if (likeness >= kMinLikeness) continue;
    if (findings.items().size() == kMaxFindings) break;
    findings.add(mismatch(where, "the description that its tiles give",
                          fmt::format("another one, of likeness {:.3f}", likeness)));
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

Findings check_place_index(const std::filesystem::path& package, const Manifest& manifest, const Mission& mission,
                           const TileSource& tiles, VerifyDepth depth, Progress& progress) {
  Findings findings;
  try {
    const std::optional<PlaceIndex> index = PlaceIndex::open(package, manifest);
    if (!index) return findings;
    const LonLat origin = index->table().origin();
    if (std::abs(origin.lon_deg - mission.takeoff.lon_deg) > 1e-7 ||
        std::abs(origin.lat_deg - mission.takeoff.lat_deg) > 1e-7) {
      findings.add(mismatch(std::string(kPlaceTableFile), "the mission's take-off point as origin", "another place"));
      return findings;
    }
    if (depth == VerifyDepth::full) findings.add(recompute(*index, manifest, tiles, progress));
  } catch (const Error& error) {
    const ErrorText& text = error.text();
    findings.add(mismatch(text.where, text.expected.empty() ? "a place index of this package's imagery" : text.expected,
                          text.found.empty() ? text.what : text.what + ": " + text.found));
  }
  return findings;
}

void verify_place_index(const std::filesystem::path& package, VerifyDepth depth, Progress& progress,
                        Verification& verification) {
  if (!verification.manifest || !verification.mission) return;
  const Manifest& manifest = *verification.manifest;
  const Artifact* imagery = manifest.artifact(kRoleImagery);
  for (const Artifact* artifact : {imagery, manifest.artifact(kRolePlaceIndex), manifest.artifact(kRolePlaceTable)}) {
    if (damaged(verification.findings, artifact)) return;  // its own finding is there
  }
  if (imagery == nullptr || verification.tiles.empty()) return;
  const std::unique_ptr<TileSource> tiles = open_tile_source(package / imagery->path);
  verification.findings.add(check_place_index(package, manifest, *verification.mission, *tiles, depth, progress));
}

void verify_place_index(const std::filesystem::path& package, VerifyDepth depth, Progress& progress, Opening& opening) {
  if (!opening.package) return;
  opening.findings.add(check_place_index(package, opening.package->manifest(), opening.package->mission(),
                                         opening.package->imagery(), depth, progress));
  if (opening.findings.refuses()) opening.package.reset();
}

}  // namespace nadir
