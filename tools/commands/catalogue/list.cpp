// nadir catalogue list: which packages there are.
#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>

#include "base/printable.hpp"
#include "catalogue/catalogue.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"

namespace nadir {
namespace {

// superseded: there is a higher sequence of the series.
const char* state_of(const CataloguedPackage& package, const std::vector<CataloguedPackage>& all, UtcTime at) {
  if (package.expires < at) return "expired";
  for (const CataloguedPackage& other : all) {
    if (other.series == package.series && other.sequence > package.sequence) return "superseded";
  }
  return "current";
}

nlohmann::json json_from(const CatalogueSource& source) {
  return {{"provider", source.provider},
          {"captured_at", to_rfc3339(source.captured_at)},
          {"gsd_m", static_cast<double>(source.gsd_mm) / 1000},
          {"ce90_m", static_cast<double>(source.ce90_mm) / 1000},
          {"trust", name_of(source.trust)},
          {"zoom", source.zoom},
          {"tiles", source.tiles}};
}

std::string line_for(const CatalogueSource& source) {
  return fmt::format("    {} {}, {:.2f} m, CE90 {:.1f} m, {} at zoom {}\n",
                     to_rfc3339(source.captured_at).substr(0, 10), printable(source.provider),
                     static_cast<double>(source.gsd_mm) / 1000, static_cast<double>(source.ce90_mm) / 1000,
                     count(static_cast<std::uint64_t>(source.tiles), "tile"), source.zoom);
}

class CatalogueListCommand final : public Command {
 public:
  std::string_view group() const override { return "catalogue"; }
  std::string_view name() const override { return "list"; }
  std::string_view summary() const override { return "list the packages of a catalogue and their sources"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::string catalogue_;
  std::optional<UtcTime> at_;
};

std::string_view CatalogueListCommand::details() const {
  return R"(One line per package, by series and sequence, followed by the imagery that it was made from.
current: the highest sequence of its series; superseded: there is a higher one; expired: no longer
valid as of --at.)";
}

std::string_view CatalogueListCommand::examples() const {
  return R"(nadir catalogue list fleet.sqlite
nadir catalogue list "PG:dbname=fleet" --json | jq '.packages[] | select(.state == "expired")')";
}

void CatalogueListCommand::setup(Options& options) {
  options.positional("CATALOGUE", catalogue_, "SpatiaLite file or \"PG:…\"").required();
  options.value("--at", at_, "TIME", "evaluate expiry as of this time");
}

int CatalogueListCommand::run(Context& context) {
  const UtcTime at = evaluation_time(at_, context.clock);
  Catalogue catalogue(parse_catalogue_location(catalogue_), Catalogue::Access::read);
  const std::vector<CataloguedPackage> packages = catalogue.packages();
  const std::vector<CatalogueSource> sources = catalogue.sources();
  nlohmann::json list = nlohmann::json::array();
  for (const CataloguedPackage& package : packages) {
    nlohmann::json made_from = nlohmann::json::array();
    std::string lines =
        fmt::format("{} {}  {}  mission {}, expires {}, {}, {:.1f} MB{}\n", printable(package.series), package.sequence,
                    state_of(package, packages, at), printable(package.mission),
                    to_rfc3339(package.expires).substr(0, 10), count(static_cast<std::uint64_t>(package.tiles), "tile"),
                    static_cast<double>(package.bytes) / 1e6, package.signers.empty() ? ", not verified" : "");
    for (const CatalogueSource& source : sources) {
      if (source.package_id != package.id) continue;
      made_from.push_back(json_from(source));
      lines += line_for(source);
    }
    if (!context.json) context.out << lines;
    list.push_back({{"series", package.series},
                    {"sequence", package.sequence},
                    {"state", state_of(package, packages, at)},
                    {"mission", package.mission},
                    {"created", to_rfc3339(package.created)},
                    {"expires", to_rfc3339(package.expires)},
                    {"manifest_sha256", package.manifest_sha256},
                    {"verified", !package.signers.empty()},
                    {"tiles", package.tiles},
                    {"bytes", package.bytes},
                    {"sources", std::move(made_from)}});
  }
  if (context.json) {
    print_json(context.out, {{"packages", std::move(list)}});
  } else if (packages.empty()) {
    context.out << "no packages\n";
  }
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_catalogue_list() { return std::make_unique<CatalogueListCommand>(); }

}  // namespace nadir
