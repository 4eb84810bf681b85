// nadir cache diff: what differs between two packages or tile sets.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <ostream>

#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/cache/tile_set_subject.hpp"
#include "commands/commands.hpp"
#include "package/tile_set_diff.hpp"

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
  std::filesystem::path before_;
  std::filesystem::path after_;
};

std::string_view CacheDiffCommand::details() const {
  return R"(Compares tiles by address and content, their sidecars, and the metadata; for two packages also the
manifests. Nothing is verified. A line begins with - for what only A has, + for what only B has,
and ~ for what differs.

Exit codes: 0 identical, 1 they differ, 2 the comparison could not be done.)";
}

std::string_view CacheDiffCommand::examples() const {
  return R"(nadir cache diff monday tuesday
nadir cache diff package others.mbtiles --json)";
}

void CacheDiffCommand::setup(Options& options) {
  options.positional("A", before_, "package, MBTiles file or COG").required();
  options.positional("B", after_, "what it is compared with").required();
}

int CacheDiffCommand::run(Context& context) {
  const TileSetSubject before = find_tile_set(before_), after = find_tile_set(after_);
  const TileSetDiff diff = diff_tile_sets(before.tiles, after.tiles, context.progress);
  std::vector<EntryChange> facts;
  if (before.manifest && after.manifest) facts = diff_entries(facts_of(*before.manifest), facts_of(*after.manifest));
  const bool same = diff.empty() && facts.empty();
  if (context.json) {
    json redescribed = json::array();
    for (const TileKey& key : diff.redescribed) redescribed.push_back(to_text(key));
    print_json(context.out, {{"same", same},
                             {"manifest", json_from(facts)},
                             {"metadata", json_from(diff.metadata)},
                             {"added", json_from(diff.added)},
                             {"removed", json_from(diff.removed)},
                             {"changed", json_from(diff.changed)},
                             {"sidecars", redescribed},
                             {"unchanged_tiles", diff.same}});
  } else {
    print(context.out, "manifest", facts);
    print(context.out, "metadata", diff.metadata);
    print(context.out, diff);
    context.out << fmt::format("{}: {} added, {} removed, {} changed, {} with a new sidecar only, {} unchanged\n",
                               same ? "identical" : "different", count(diff.added.size(), "tile"), diff.removed.size(),
                               diff.changed.size(), diff.redescribed.size(), diff.same);
  }
  return same ? kAccepted : kRefused;
}

}  // namespace

std::unique_ptr<Command> make_cache_diff() { return std::make_unique<CacheDiffCommand>(); }

}  // namespace nadir
