// nadir catalogue gaps: what no imagery of a catalogue serves of a mission.
#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>

#include "base/files.hpp"
#include "base/printable.hpp"
#include "catalogue/catalogue.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"

namespace nadir {
namespace {

using nlohmann::json;

json geometry_json(const GeoArea& area) {
  json polygons = json::array();
  for (const GeoPolygon& polygon : area) {
    json rings = json::array();
    for (const GeoRing& ring : polygon) {
      json points = json::array();
      for (const LonLat& place : ring) points.push_back({rounded(place.lon_deg, 1e8), rounded(place.lat_deg, 1e8)});
      rings.push_back(std::move(points));
    }
    polygons.push_back(std::move(rings));
  }
  return {{"type", "MultiPolygon"}, {"coordinates", std::move(polygons)}};
}

json document_from(const std::vector<CatalogueGap>& gaps) {
  json features = json::array();
  for (const CatalogueGap& gap : gaps) {
    features.push_back({{"type", "Feature"},
                        {"geometry", geometry_json(gap.outline)},
                        {"properties",
                         {{"tile", to_text(gap.key)},
                          {"zoom", gap.key.z},
                          {"reason", gap.reason},
                          {"area_m2", rounded(gap.area_m2, 10)},
                          {"sector", gap.sector.empty() ? json() : json(gap.sector)}}}});
  }
  return {{"type", "FeatureCollection"}, {"features", std::move(features)}};
}

std::string summary_of(const std::vector<CatalogueGap>& gaps) {
  std::map<std::string, std::pair<std::size_t, double>> reasons;
  for (const CatalogueGap& gap : gaps) {
    auto& [tiles, area_m2] = reasons[gap.reason];
    ++tiles, area_m2 += gap.area_m2;
  }
  std::string text;
  for (const auto& [reason, total] : reasons) {
    text += fmt::format("{}: {}, {:.0f} m²\n", printable(reason), count(total.first, "tile"), total.second);
  }
  return text.empty() ? "no gaps\n" : text;
}

class CatalogueGapsCommand final : public Command {
 public:
  std::string_view group() const override { return "catalogue"; }
  std::string_view name() const override { return "gaps"; }
  std::string_view summary() const override { return "outline where the catalogued imagery does not cover a mission"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::string catalogue_;
  std::filesystem::path mission_;
  std::optional<std::filesystem::path> out_;
  std::optional<UtcTime> at_;
  bool store_ = false;
};

std::string_view CatalogueGapsCommand::details() const {
  return R"(Checks a mission's sectors and corridor against the footprints of all sources in the catalogue,
whatever package they came with: at the mission's finest zoom, pixel by pixel, by its freshness
days as of --at and its min_resolution_m. One feature per tile; the reason is "no imagery",
"coarse imagery", or "stale imagery" where some is fine enough. Expired packages count: their
imagery can be built into a new one. Without --out the GeoJSON goes to standard output. --store also
writes the gaps to the catalogue's layer `gaps`, replacing earlier ones of this mission.

Exit codes: 0 no gaps, 1 there are gaps, 2 the check could not be done.)";
}

std::string_view CatalogueGapsCommand::examples() const {
  return R"(nadir catalogue gaps fleet.sqlite --mission next.yaml --out order.geojson
nadir catalogue gaps "PG:dbname=fleet" --mission next.yaml --at 2026-12-01 --store)";
}

void CatalogueGapsCommand::setup(Options& options) {
  options.positional("CATALOGUE", catalogue_, "SpatiaLite file or \"PG:…\"").required();
  options.value("--mission", mission_, "MISSION.yaml", "planned mission").required();
  options.value("--out", out_, "FILE.geojson", "where the outlines go; default: standard output");
  options.flag("--store", store_, "also write the gaps to the catalogue's layer");
  options.value("--at", at_, "TIME", "evaluate ages as of this time");
}

int CatalogueGapsCommand::run(Context& context) {
  const UtcTime at = evaluation_time(at_, context.clock);
  const Mission mission = read_mission(mission_);
  const CatalogueLocation location = parse_catalogue_location(catalogue_);
  std::vector<CatalogueSource> sources;
  {
    Catalogue catalogue(location, Catalogue::Access::read);
    sources = catalogue.sources();
  }
  const std::vector<CatalogueGap> gaps = gaps_of_imagery(mission, sources, at);
  if (store_) Catalogue(location, Catalogue::Access::write).store_gaps(mission.id, at, gaps);
  if (out_) {
    write_file_atomic(*out_, document_from(gaps).dump(1) + "\n");
    context.out << summary_of(gaps);
  } else {
    print_json(context.out, document_from(gaps));
  }
  return gaps.empty() ? kAccepted : kRefused;
}

}  // namespace

std::unique_ptr<Command> make_catalogue_gaps() { return std::make_unique<CatalogueGapsCommand>(); }

}  // namespace nadir
