// nadir catalogue remove: a package and all that belongs to it goes.
#include <fmt/format.h>

#include <cstdint>
#include <ostream>

#include "base/error.hpp"
#include "base/printable.hpp"
#include "catalogue/catalogue.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "commands/commands.hpp"

namespace nadir {
namespace {

class CatalogueRemoveCommand final : public Command {
 public:
  std::string_view group() const override { return "catalogue"; }
  std::string_view name() const override { return "remove"; }
  std::string_view summary() const override { return "remove a package from a catalogue"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::string series_;
  std::int64_t sequence_ = 0;
  std::string catalogue_;
};

std::string_view CatalogueRemoveCommand::details() const {
  return R"(Its sources, sectors, tiles and gaps are removed with it, in one transaction. The package itself is
not touched.

Exit codes: 0 removed, 2 there was no such package, or the job could not be done.)";
}

std::string_view CatalogueRemoveCommand::examples() const {
  return R"(nadir catalogue remove village 3 --from fleet.sqlite)";
}

void CatalogueRemoveCommand::setup(Options& options) {
  options.positional("SERIES", series_, "series of the package").required();
  options.positional("SEQUENCE", sequence_, "sequence of the package").required();
  options.value("--from", catalogue_, "CATALOGUE", "SpatiaLite file or \"PG:…\"").required();
}

int CatalogueRemoveCommand::run(Context& context) {
  const CatalogueLocation location = parse_catalogue_location(catalogue_);
  {
    // Looked up without writing first: a catalogue must not come into being because something was to leave it.
    Catalogue reader(location, Catalogue::Access::read);
  }
  if (!Catalogue(location, Catalogue::Access::write).remove(series_, sequence_)) {
    throw UsageError({.what = "no such package in the catalogue",
                      .where = location.shown,
                      .expected = "a series and sequence that `nadir catalogue list` shows",
                      .found = printable(fmt::format("{} {}", series_, sequence_))});
  }
  context.out << printable(fmt::format("removed {} {}", series_, sequence_)) << '\n';
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_catalogue_remove() { return std::make_unique<CatalogueRemoveCommand>(); }

}  // namespace nadir
