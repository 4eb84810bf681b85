// nadir cache diff: what differs between two packages or tile sets.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>

#include "base/files.hpp"
#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/cache/package_signer.hpp"
#include "commands/cache/tile_set_subject.hpp"
#include "commands/commands.hpp"
#include "commands/keys/root_signing.hpp"
#include "package/tile_set_diff.hpp"
#include "package_delta/package_patch.hpp"
#include "trust/root.hpp"

namespace nadir {
namespace {

using nlohmann::json;

Entries facts_of(const Manifest& manifest) {
  Entries facts{{"mission", manifest.mission_id},
                {"series", manifest.series},
                {"sequence", std::to_string(manifest.sequence)},
                {"created", to_rfc3339(manifest.created)},
                {"expires", to_rfc3339(manifest.expires)},
                {"airframes", fmt::format("{}", fmt::join(manifest.airframes, ", "))}};
  for (const Artifact& artifact : manifest.artifacts) {
    facts["file " + artifact.path] = fmt::format("{} bytes, sha256 {}", artifact.size, artifact.sha256.hex());
  }
  return facts;
}

json json_from(const std::vector<EntryChange>& changes) {
  json list = json::array();
  for (const EntryChange& change : changes) {
    list.push_back({{"name", change.name},
                    {"before", change.before ? json(*change.before) : json()},
                    {"after", change.after ? json(*change.after) : json()}});
  }
  return list;
}

json json_from(const std::vector<TileChange>& changes) {
  json list = json::array();
  for (const TileChange& change : changes) {
    json item{{"tile", to_text(change.key)}};
    if (change.before) item["before"] = change.before->hex();
    if (change.after) item["after"] = change.after->hex();
    list.push_back(std::move(item));
  }
  return list;
}

void print(std::ostream& out, const char* kind, const std::vector<EntryChange>& changes) {
  for (const EntryChange& change : changes) {
    out << printable(fmt::format("~ {} {}: {} -> {}", kind, change.name, change.before.value_or("(none)"),
                                 change.after.value_or("(none)")))
        << '\n';
  }
}

void print(std::ostream& out, const TileSetDiff& diff) {
  for (const TileChange& tile : diff.removed) {
    out << fmt::format("- tile {} {}\n", to_text(tile.key), tile.before->hex());
  }
  for (const TileChange& tile : diff.added) {
    out << fmt::format("+ tile {} {}\n", to_text(tile.key), tile.after->hex());
  }
  for (const TileChange& tile : diff.changed) {
    out << fmt::format("~ tile {} {} -> {}\n", to_text(tile.key), tile.before->hex(), tile.after->hex());
  }
  for (const TileKey& key : diff.redescribed) out << fmt::format("~ sidecar {}\n", to_text(key));
}

// Which tiles of which zoom, and where.
struct ChangeCounts {
  std::size_t added = 0, removed = 0, changed = 0, redescribed = 0;
};

void print_summary(std::ostream& out, const TileSetDiff& diff) {
  std::map<int, ChangeCounts> zooms;
  for (const TileChange& tile : diff.added) ++zooms[tile.key.z].added;
  for (const TileChange& tile : diff.removed) ++zooms[tile.key.z].removed;
  for (const TileChange& tile : diff.changed) ++zooms[tile.key.z].changed;
  for (const TileKey& key : diff.redescribed) ++zooms[key.z].redescribed;
  for (const auto& [zoom, counts] : zooms) {
    out << fmt::format("  zoom {}: {} added, {} removed, {} changed, {} with a new sidecar only\n", zoom, counts.added,
                       counts.removed, counts.changed, counts.redescribed);
  }
  LonLatBox box{180, 90, -180, -90};
  const auto add = [&box](const TileKey& key) {
    const LonLatBox tile = bounds_of(key);
    box = {std::min(box.west_deg, tile.west_deg), std::min(box.south_deg, tile.south_deg),
           std::max(box.east_deg, tile.east_deg), std::max(box.north_deg, tile.north_deg)};
  };
  if (zooms.empty()) return;
  const int finest = zooms.rbegin()->first;
  for (const auto* changes : {&diff.added, &diff.removed, &diff.changed}) {
    for (const TileChange& tile : *changes) {
      if (tile.key.z == finest) add(tile.key);
    }
  }
  for (const TileKey& key : diff.redescribed) {
    if (key.z == finest) add(key);
  }
  out << fmt::format("  between {:.6f},{:.6f} and {:.6f},{:.6f}\n", box.west_deg, box.south_deg, box.east_deg,
                     box.north_deg);
}

// The tiles that differ, as polygons: for a map of the changes.
json geojson_of(const TileSetDiff& diff) {
  json features = json::array();
  const auto add = [&features](const TileKey& key, const char* change) {
    const LonLatBox box = bounds_of(key);
    const json ring =
        json::array({json::array({box.west_deg, box.south_deg}), json::array({box.east_deg, box.south_deg}),
                     json::array({box.east_deg, box.north_deg}), json::array({box.west_deg, box.north_deg}),
                     json::array({box.west_deg, box.south_deg})});
    features.push_back({{"type", "Feature"},
                        {"geometry", {{"type", "Polygon"}, {"coordinates", json::array({ring})}}},
                        {"properties", {{"tile", to_text(key)}, {"zoom", key.z}, {"change", change}}}});
  };
  for (const TileChange& tile : diff.added) add(tile.key, "added");
  for (const TileChange& tile : diff.removed) add(tile.key, "removed");
  for (const TileChange& tile : diff.changed) add(tile.key, "changed");
  for (const TileKey& key : diff.redescribed) add(key, "sidecar");
  return {{"type", "FeatureCollection"}, {"features", std::move(features)}};
}

class CacheDiffCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "diff"; }
  std::string_view summary() const override { return "list what differs between two packages or tile sets"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::optional<MadePatch> patch(Context& context) const;

  std::filesystem::path before_;
  std::filesystem::path after_;
  bool list_ = false;
  std::optional<std::filesystem::path> geojson_;
  std::optional<std::filesystem::path> patch_;
  std::vector<std::filesystem::path> keys_;
  std::optional<std::filesystem::path> trust_;
};

std::string_view CacheDiffCommand::details() const {
  return R"(Compares tiles by address and content, their sidecars, and the metadata; for two packages also the
manifests. Nothing is verified. The summary comes first; with --list a line for each difference
follows: - for what only A has, + for what only B has, and ~ for what differs.

--patch writes a file that makes package B of package A (`nadir cache apply`), for links over which B
itself is too large; what did not change is not in it. It is signed like a package, so that an
aircraft's operator need not trust the link. B must be what its manifest says.

Exit codes: 0 identical, or the patch was written; 1 they differ, or B is not what its manifest says
and there is no patch; 2 the comparison could not be done.)";
}

std::string_view CacheDiffCommand::examples() const {
  return R"(nadir cache diff monday tuesday
nadir cache diff package others.mbtiles --json
nadir cache diff package package2 --patch 1-to-2.patch --key planner.key.pem --trust root.json)";
}

void CacheDiffCommand::setup(Options& options) {
  options.positional("A", before_, "package, MBTiles, COG or PMTiles file").required();
  options.positional("B", after_, "what it is compared with").required();
  options.flag("--list", list_, "list every difference");
  options.value("--geojson", geojson_, "FILE.geojson", "write the tiles that differ as polygons, for a map");
  options.value("--patch", patch_, "FILE", "write a signed patch that makes B of A; an existing file is replaced")
      .needs("--key");
  options
      .values("--key", keys_, "KEY.pem",
              "with --patch: private key (file or pkcs11: URI) of a package signer; may be repeated")
      .needs("--patch");
  options
      .value("--trust", trust_, "ROOT.json",
             "with --patch: root that the receivers hold: the keys must be package signers of it")
      .needs("--patch");
}

std::optional<MadePatch> CacheDiffCommand::patch(Context& context) const {
  if (!patch_) return std::nullopt;
  const std::vector<PrivateKey> keys = read_private_keys(keys_);
  std::optional<TrustRoot> installed;
  if (trust_) installed = read_trusted_root(*trust_);
  std::vector<const PrivateKey*> signers;
  for (const PrivateKey& key : keys) {
    require_package_signer(key, installed, {}, context);
    signers.push_back(&key);
  }
  return make_patch(before_, after_, signers, *patch_, context.progress);
}

int CacheDiffCommand::run(Context& context) {
  const TileSetSubject before = find_tile_set(before_), after = find_tile_set(after_);
  const TileSetDiff diff = diff_tile_sets(before.tiles, after.tiles, context.progress);
  std::vector<EntryChange> facts;
  if (before.manifest && after.manifest) facts = diff_entries(facts_of(*before.manifest), facts_of(*after.manifest));
  const bool same = diff.empty() && facts.empty();
  const std::optional<MadePatch> made = patch(context);
  if (made && made->findings.has_errors()) return report_findings(context.out, context.json, made->findings);
  if (geojson_) write_file_atomic(*geojson_, geojson_of(diff).dump() + "\n");
  if (context.json) {
    json redescribed = json::array();
    for (const TileKey& key : diff.redescribed) redescribed.push_back(to_text(key));
    json result{{"same", same},
                {"manifest", json_from(facts)},
                {"metadata", json_from(diff.metadata)},
                {"added", json_from(diff.added)},
                {"removed", json_from(diff.removed)},
                {"changed", json_from(diff.changed)},
                {"sidecars", redescribed},
                {"unchanged_tiles", diff.same}};
    if (made) {
      result["patch"] = {{"file", patch_->string()}, {"bytes", made->bytes}, {"package_bytes", made->package_bytes}};
    }
    print_json(context.out, result);
  } else {
    context.out << fmt::format("{}: {} added, {} removed, {} changed, {} with a new sidecar only, {} unchanged\n",
                               same ? "identical" : "different", count(diff.added.size(), "tile"), diff.removed.size(),
                               diff.changed.size(), diff.redescribed.size(), diff.same);
    print_summary(context.out, diff);
    print(context.out, "manifest", facts);
    print(context.out, "metadata", diff.metadata);
    if (list_) print(context.out, diff);
    if (made) {
      context.out << fmt::format("patch: {}, {:.2f} MB; the package has {:.2f} MB\n", patch_->string(),
                                 static_cast<double>(made->bytes) / 1e6,
                                 static_cast<double>(made->package_bytes) / 1e6);
    }
  }
  return same || made ? kAccepted : kRefused;
}

}  // namespace

std::unique_ptr<Command> make_cache_diff() { return std::make_unique<CacheDiffCommand>(); }

}  // namespace nadir
