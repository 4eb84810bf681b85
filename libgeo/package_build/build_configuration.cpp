#include "package_build/build_configuration.hpp"

#include <fmt/format.h>

#include "base/digest.hpp"
#include "raster/gdal_dataset.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

// One digest over all files of the raster: of a VRT also those that it refers to, of any its masks and overviews.
std::string digest_of(const fs::path& raster) {
  Sha256Stream all;
  for (const fs::path& file : files_of_raster(raster)) all.update(ByteView(sha256_file(file).bytes));
  return all.finish().hex();
}

}  // namespace

std::string describe_build(const PackageRequest& request, std::string_view mission_text,
                           std::span<const ImageryInput> inputs) {
  std::string text =
      fmt::format("program: {}\nmission: sha256 {}\n", request.program, sha256(as_bytes(mission_text)).hex());
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    const ImageryFacts& facts = inputs[i].facts;
    text += fmt::format("imagery {}: sha256 {}, captured {}, gsd {}, ce90 {}, provider {}, stretch {}\n", i + 1,
                        digest_of(inputs[i].path), to_rfc3339(facts.captured_at), facts.gsd_m, facts.ce90_m,
                        facts.provider, inputs[i].stretch ? to_text(*inputs[i].stretch) : "none");
  }
  text += fmt::format("seams: feather {} m\n", request.tiles.mosaic.feather_m);
  text += fmt::format("dem: {}\n", request.dem ? "sha256 " + digest_of(*request.dem) : "none");
  text += fmt::format("tiles: {}, quality {}{}, in {}\n", name_of(request.tiles.encoding.format),
                      request.tiles.encoding.quality, request.tiles.encoding.lossless ? ", lossless" : "",
                      file_of(request.tiles.container));
  text += fmt::format("judged at: {}\n", request.at ? to_rfc3339(*request.at) : "the mission's created");
  for (const auto& [version, root] : request.roots) {
    text += fmt::format("root {}: sha256 {}\n", version, sha256(as_bytes(root)).hex());
  }
  text += fmt::format("key: {}\n", request.key != nullptr ? request.key->public_key().id() : "none");
  return text;
}

}  // namespace nadir
