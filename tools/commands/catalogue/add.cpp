// nadir catalogue add: a package becomes layers of a spatial database.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>

#include "base/printable.hpp"
#include "catalogue/catalogue.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "trust/root.hpp"

namespace nadir {
namespace {

const char* word_for(Catalogue::Added added) {
  switch (added) {
    case Catalogue::Added::added: return "added";
    case Catalogue::Added::known: return "known";
    case Catalogue::Added::conflict: break;
  }
  return "conflict";
}

class CatalogueAddCommand final : public Command {
 public:
  std::string_view group() const override { return "catalogue"; }
  std::string_view name() const override { return "add"; }
  std::string_view summary() const override { return "add a package to a catalogue (SpatiaLite or PostGIS)"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path package_;
  std::string catalogue_;
  std::optional<std::filesystem::path> trust_;
  std::optional<UtcTime> at_;
};

std::string_view CatalogueAddCommand::details() const {
  return R"(Writes the package's purpose and sources as layers that QGIS and GDAL open: packages, sources with
their footprints, sectors, routes, corridors, required tiles, tiles, gaps. The catalogue is a
SpatiaLite file, created if missing, or a PostgreSQL database with PostGIS, named as
"PG:dbname=… host=…" (libpq's keywords; keep the password in ~/.pgpass). A package is added
completely or not at all; adding it again changes nothing; other sequences of its series are kept.

With --trust the package is verified first (depth quick), and its signers are recorded. Without it,
the package's parts must be consistent, and it is recorded as not verified.

Exit codes: 0 the package is in the catalogue, 1 rejected, or another package has its series and
sequence, 2 the job could not be done.)";
}

std::string_view CatalogueAddCommand::examples() const {
  return R"(nadir catalogue add package --to fleet.sqlite --trust root.json
nadir catalogue add package --to "PG:dbname=fleet host=db.example.org user=planner" --trust root.json)";
}

void CatalogueAddCommand::setup(Options& options) {
  options.positional("PACKAGE", package_, "package folder").required();
  options.value("--to", catalogue_, "CATALOGUE", "SpatiaLite file or \"PG:…\"").required();
  options.value("--trust", trust_, "ROOT.json", "verify the package with this root of trust first");
  options.value("--at", at_, "TIME", "evaluate validity as of this time").needs("--trust");
}

int CatalogueAddCommand::run(Context& context) {
  const CatalogueLocation location = parse_catalogue_location(catalogue_);
  std::optional<TrustRoot> root;
  VerifyOptions options;
  if (trust_) {
    root = read_trusted_root(*trust_);
    options.root = &*root;
    options.at = evaluation_time(at_, context.clock);
  }
  CatalogueReading reading = read_catalogue_entry(package_, trust_ ? &options : nullptr, context.progress);
  if (!reading.entry) return report_findings(context.out, context.json, reading.findings);
  const CatalogueEntry& entry = *reading.entry;
  Catalogue catalogue(location, Catalogue::Access::write);
  const Catalogue::Added added = catalogue.add(entry, context.progress);
  const std::string name = fmt::format("{} {}", entry.manifest.series, entry.manifest.sequence);
  if (added == Catalogue::Added::conflict) {
    reading.findings.add(
        {.code = "catalogue.conflict",
         .where = location.shown,
         .expected = fmt::format("one package named {}", name),
         .found = "another one of this series and sequence, with different content",
         .fix = "give the changed package a higher sequence; to replace the other one, remove it first: nadir "
                "catalogue remove"});
  }
  if (context.json) {
    return report_findings(context.out, true, reading.findings,
                           {{"catalogue", location.shown},
                            {"result", word_for(added)},
                            {"series", entry.manifest.series},
                            {"sequence", entry.manifest.sequence},
                            {"tiles", entry.tiles.size()},
                            {"verified", entry.signers.has_value()}});
  }
  if (!reading.findings.empty()) print_findings(context.out, reading.findings);
  if (added == Catalogue::Added::added) {
    context.out << fmt::format("added {}: {}{}\n", printable(name), count(entry.tiles.size(), "tile"),
                               entry.signers ? "" : ", not verified (no --trust)");
  } else if (added == Catalogue::Added::known) {
    context.out << fmt::format("{} is already in the catalogue; nothing changed\n", printable(name));
  }
  return reading.findings.has_errors() ? kRefused : kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_catalogue_add() { return std::make_unique<CatalogueAddCommand>(); }

}  // namespace nadir
