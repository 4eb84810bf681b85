#include "commands/catalogue/remove.hpp"

#include <fmt/format.h>

#include <ostream>

#include "base/error.hpp"
#include "base/printable.hpp"
#include "cli/options.hpp"
#include "catalogue/catalogue.hpp"

namespace nadir {

std::string_view CatalogueRemoveCommand::details() const {
  return "Its sources, sectors, tiles and gaps go with it, in one transaction. The package itself is not touched. "
         "Exit\n"
         "code 0: it is gone; 2: there was none, or it could not be done.";
}

std::string_view CatalogueRemoveCommand::examples() const {
  return "nadir catalogue remove village 3 --from fleet.sqlite";
}

void CatalogueRemoveCommand::setup(Options& options) {
  options.positional("SERIES", series_, "the package's series").required();
  options.positional("SEQUENCE", sequence_, "its sequence").required();
  options.value("--from", catalogue_, "CATALOGUE", "a SpatiaLite file or \"PG:…\"").required();
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
  context.out << printable(fmt::format("removed {} {}\n", series_, sequence_));
  return kAccepted;
}

}  // namespace nadir
