// nadir catalogue export: a catalogue for programs that read neither SpatiaLite nor PostGIS.
#include <fmt/format.h>
#include <gdal_priv.h>

#include <array>
#include <filesystem>
#include <memory>
#include <ostream>
#include <string>

#include "base/error.hpp"
#include "base/files.hpp"
#include "catalogue/database.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "commands/commands.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/gdal_drivers.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr std::array kViews{"package_states", "finest_tiles",    "source_states", "sector_states",
                            "route_states",   "corridor_states", "gap_states"};

class CatalogueExportCommand final : public Command {
 public:
  std::string_view group() const override { return "catalogue"; }
  std::string_view name() const override { return "export"; }
  std::string_view summary() const override { return "export a catalogue as GeoParquet or GeoPackage"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::string catalogue_, format_;
  fs::path out_;
};

std::string_view CatalogueExportCommand::details() const {
  return R"(Exports the catalogue's views: packages, finest tiles, sources, sectors, routes, corridors and gaps,
each with series, sequence and whether it is current. gpkg: OUT is a GeoPackage with a layer for each.
parquet: OUT is a folder with a file of GeoParquet for each; needs a GDAL built with Apache Arrow,
which Debian 12 does not provide.

Exit codes: 0 exported, 2 the job could not be done.)";
}

std::string_view CatalogueExportCommand::examples() const {
  return R"(nadir catalogue export fleet.sqlite --format gpkg --out fleet.gpkg
nadir catalogue export "PG:dbname=fleet host=db.example.org user=planner" --format parquet --out fleet)";
}

void CatalogueExportCommand::setup(Options& options) {
  options.positional("CATALOGUE", catalogue_, "SpatiaLite file or \"PG:…\"").required();
  options.value("--format", format_, "FORMAT", "output format").required().one_of({"parquet", "gpkg"});
  options.value("--out", out_, "OUT", "folder (parquet) or file (gpkg) to create; must not exist").required();
}

// A file with a layer for each view.
template <typename Views>
void write_views(CatalogueDatabase& database, const Views& views, const char* driver, const fs::path& file) {
  const QuietGdal quiet;
  GdalHandle target(vector_writer(driver, file).Create(file.c_str(), 0, 0, 0, GDT_Unknown, nullptr));
  const auto need = [&file](bool ok) {
    if (ok) return;
    throw Error({.what = "the catalogue cannot be exported",
                 .where = file.string(),
                 .found = QuietGdal::last_error(),
                 .fix = "check the folder's free space and permissions, and export again"});
  };
  need(target != nullptr);
  for (const char* view : views) database.copy_view(view, *target);
  CPLErrorReset();
  target.reset();  // writes the rest
  need(CPLGetLastErrorType() < CE_Failure);
}

int CatalogueExportCommand::run(Context& context) {
  if (fs::exists(out_)) {
    throw UsageError({.what = "the output already exists", .where = out_.string(), .fix = "choose another --out"});
  }
  const CatalogueLocation location = parse_catalogue_location(catalogue_);
  const CatalogueLayout layout = fleet_catalogue();
  CatalogueDatabase database(location, CatalogueDatabase::Access::read, layout);
  if (!database.has_views()) {
    throw Error({.what = "the catalogue has no views to export",
                 .where = location.shown,
                 .fix = fmt::format("run `{}` once as a user who may create views there", layout.maker)});
  }
  const bool one_file = format_ == "gpkg";
  StagingDirectory staging(one_file ? fs::path(out_.string() + ".export") : out_);
  if (one_file) {
    write_views(database, kViews, "GPKG", staging.path() / "out.gpkg");
    fs::rename(staging.path() / "out.gpkg", out_);
  } else {
    for (const char* view : kViews) {
      write_views(database, std::array{view}, "Parquet", staging.path() / fmt::format("{}.parquet", view));
    }
    staging.commit();
  }
  context.out << fmt::format("{}: {} views\n", out_.string(), kViews.size());
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_catalogue_export() { return std::make_unique<CatalogueExportCommand>(); }

}  // namespace nadir
