#include "candidates/export.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <ostream>

#include "base/files.hpp"
#include "candidates/candidate_catalogue.hpp"
#include "candidates/catalogue_option.hpp"
#include "candidates/promoted_imagery.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"

namespace nadir {

std::string_view ExportCommand::details() const {
  return "OUT appears whole or not at all: a Cloud Optimized GeoTIFF for each day and each block of 16 by 16 tiles, "
         "with\n"
         "a STAC Item beside it that says when it was taken, how fine and how well placed it is. It may run beside "
         "the\n"
         "service. Exit code 1: nothing is promoted, and nothing was written.";
}

std::string_view ExportCommand::examples() const {
  return "nadir-candidates export --data /srv/candidates --out promoted\n"
         "nadir cache build --mission next.yaml --imagery promoted/*.tif --imagery map.tif --out next";
}

void ExportCommand::setup(Options& options) {
  options.value("--data", data_, "DIR", "the service's folder").required();
  options.value("--catalogue", catalogue_, "CATALOGUE", "where it is not DATA/catalogue.sqlite");
  options.value("--out", out_, "OUT", "folder that is made").required();
}

int ExportCommand::run(Context& context) {
  CandidateCatalogue catalogue(catalogue_location(catalogue_, data_), CandidateCatalogue::Access::read);
  const PackStore packs(data_ / "packs");
  std::vector<PromotedTile> tiles;
  catalogue.each_promoted([&tiles](const PromotedTile& tile) { tiles.push_back(tile); });
  nlohmann::json list = nlohmann::json::array();
  if (tiles.empty()) {
    if (context.json) {
      print_json(context.out, {{"images", list}});
    } else {
      context.out << "nothing is promoted\n";
    }
    return kRefused;
  }
  StagingDirectory staging(out_);
  for (const ExportedImage& image : write_promoted(std::move(tiles), packs, staging.path(), context.progress)) {
    const std::string file = (out_ / image.file.filename()).string();
    list.push_back({{"file", file},
                    {"tiles", image.tiles},
                    {"captured_at", to_rfc3339(image.captured_at)},
                    {"gsd_m", image.gsd_m},
                    {"ce90_m", image.ce90_m}});
    if (!context.json) {
      context.out << fmt::format("{}  {} tiles, {}, GSD {:.2f} m, CE90 {:.1f} m\n", file, image.tiles,
                                 to_rfc3339(image.captured_at).substr(0, 10), image.gsd_m, image.ce90_m);
    }
  }
  staging.commit();
  if (context.json) print_json(context.out, {{"images", std::move(list)}});
  return kAccepted;
}

}  // namespace nadir
