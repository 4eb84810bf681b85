// nadir catalogue project: a project of QGIS that shows a catalogue.
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <ostream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "candidates/candidate_catalogue.hpp"
#include "catalogue/database.hpp"
#include "catalogue/qgis_project.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "commands/commands.hpp"

namespace nadir {
namespace {

// With its views, which a catalogue of an earlier version gets when it is opened for writing. Creates none.
std::unique_ptr<CatalogueDatabase> open_with_views(const CatalogueLocation& location, const CatalogueLayout& layout,
                                                   bool to_write) {
  using Access = CatalogueDatabase::Access;
  auto database = std::make_unique<CatalogueDatabase>(location, Access::read, layout);
  if (!to_write && database->has_views()) return database;
  database.reset();
  database = std::make_unique<CatalogueDatabase>(location, Access::write, layout);
  if (database->has_views()) return database;
  throw Error({.what = "the catalogue has no views to show",
               .where = location.shown,
               .fix = fmt::format("run `{}` once as a user who may create views there", layout.maker)});
}

class CatalogueProjectCommand final : public Command {
 public:
  std::string_view group() const override { return "catalogue"; }
  std::string_view name() const override { return "project"; }
  std::string_view summary() const override { return "write a QGIS project that shows a catalogue"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::string catalogue_;
  std::optional<std::string> candidates_;
  std::filesystem::path out_;
  bool store_styles_ = false;
};

std::string_view CatalogueProjectCommand::details() const {
  return R"(The project shows what is current: packages with series and sequence as labels, coverage by the age
of the imagery, gaps, routes and sectors. Earlier versions, tiles and corridors are layers that are
switched off. With --candidates the tiles that aircraft sent are shown by their verdict, and those
that were promoted. QGIS reads the catalogue each time that it draws, so that one project is enough:
what is added later is shown too. Files are named relative to the project; keep both together.

With --store-styles layers that are added to other projects by hand look the same: the styles are
stored in the database's table layer_styles, where QGIS finds those of PostGIS. Other styles there
are kept.

Exit codes: 0 written, 2 the job could not be done.)";
}

std::string_view CatalogueProjectCommand::examples() const {
  return R"(nadir catalogue project fleet.sqlite --out fleet.qgs
nadir catalogue project fleet.sqlite --candidates service/catalogue.sqlite --out fleet.qgs
nadir catalogue project "PG:dbname=fleet host=db.example.org user=planner" --store-styles --out fleet.qgs)";
}

void CatalogueProjectCommand::setup(Options& options) {
  options.positional("CATALOGUE", catalogue_, "SpatiaLite file or \"PG:…\"").required();
  options.value("--out", out_, "FILE.qgs", "project to create; must not exist").required();
  options.value("--candidates", candidates_, "CATALOGUE", "catalogue of a candidate service, to show as well");
  options.flag("--store-styles", store_styles_, "also store the styles in the catalogue");
}

int CatalogueProjectCommand::run(Context& context) {
  if (out_.extension() != ".qgs") {
    throw UsageError(
        {.what = "not a name for a QGIS project", .where = out_.string(), .expected = "a name that ends with .qgs"});
  }
  QgisProject project{.packages = parse_catalogue_location(catalogue_),
                      .candidates = {},
                      .folder = std::filesystem::absolute(out_).parent_path(),
                      .extent = {}};
  const auto packages = open_with_views(project.packages, fleet_catalogue(), store_styles_);
  project.extent = qgis_extent(*packages);
  std::unique_ptr<CatalogueDatabase> candidates;
  if (candidates_) {
    project.candidates = parse_catalogue_location(*candidates_);
    candidates = open_with_views(*project.candidates, candidate_catalogue_layout(), store_styles_);
  }
  write_new_file(out_, qgis_project_xml(project));
  if (store_styles_) store_qgis_styles(*packages, project.packages, QgisStyles::packages);
  if (store_styles_ && candidates) store_qgis_styles(*candidates, *project.candidates, QgisStyles::candidates);
  context.out << fmt::format("{}: open it with QGIS 3.22 or newer\n", out_.string());
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_catalogue_project() { return std::make_unique<CatalogueProjectCommand>(); }

}  // namespace nadir
