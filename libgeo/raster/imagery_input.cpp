#include "raster/imagery_input.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <string_view>
#include <utility>

#include "base/error.hpp"
#include "raster/gdal_drivers.hpp"
#include "raster/pinned_files.hpp"
#include "raster/raster_source.hpp"
#include "raster/stretch.hpp"

namespace nadir {
ImageryFacts read_imagery_facts(const StacItem& item, const ImageryOverrides& overrides) {
  const auto text = [&](const std::optional<std::string>& stated, std::string_view name, std::size_t most) {
    std::string value = stated ? *stated : item.optional_text(name);
    if (value.size() <= most) return value;
    throw UsageError(
        {.what = fmt::format("the imagery's {} is too long", name),
         .where = stated ? "--" + std::string(name) : item.where(),
         .expected = fmt::format("at most {} bytes", most),
         .found = fmt::format("{} bytes", value.size()),
         .fix = "state the SPDX identifier of the licence, and the shortest attribution that it asks for"});
  };
  return {
      .captured_at = overrides.captured_at ? *overrides.captured_at : item.captured_at(),
      .gsd_m = overrides.gsd_m ? *overrides.gsd_m : item.gsd_m(),
      .ce90_m = overrides.ce90_m ? *overrides.ce90_m : item.ce90_m(),
      .provider = overrides.provider ? *overrides.provider : item.provider(),
      .licence = text(overrides.licence, "license", kMaxLicence),
      .attribution = text(overrides.attribution, "attribution", kMaxAttribution),
  };
}

ImageryFacts read_imagery_facts(const std::filesystem::path& raster, const ImageryOverrides& overrides) {
  return read_imagery_facts(StacItem::beside(raster), overrides);
}

namespace {

constexpr std::string_view kBetweenNames = " + ";

// The provider may itself be the source of a tile that was made from several.
std::vector<std::string_view> provider_names(std::string_view provider) {
  std::vector<std::string_view> names;
  for (std::size_t end = provider.find(kBetweenNames); end != std::string_view::npos;
       end = provider.find(kBetweenNames)) {
    names.push_back(provider.substr(0, end));
    provider.remove_prefix(end + kBetweenNames.size());
  }
  names.push_back(provider);
  return names;
}

}  // namespace

void set_facts(Sidecar& sidecar, std::span<const ImageryInput> inputs, const InputShares& used) {
  // Rounded up: 0.1614 m is not within a limit of 0.161 m.
  const auto millimetres = [](double metres) { return static_cast<std::int64_t>(std::ceil(metres * 1000.0 - 1e-6)); };
  std::map<std::string, std::uint64_t> providers;
  sidecar.trust = TileTrust::service;
  bool first = true;
  for (const auto& [index, pixels] : used) {
    const ImageryFacts& facts = inputs[index].facts;
    sidecar.captured_at = first ? facts.captured_at : std::min(sidecar.captured_at, facts.captured_at);
    sidecar.gsd_mm = std::max(first ? 0 : sidecar.gsd_mm, millimetres(facts.gsd_m));
    sidecar.ce90_mm = std::max(first ? 0 : sidecar.ce90_mm, millimetres(facts.ce90_m));
    sidecar.trust = std::max(sidecar.trust, inputs[index].trust);
    providers[facts.provider] += pixels;
    first = false;
  }
  std::vector<std::pair<std::string, std::uint64_t>> order(providers.begin(), providers.end());
  std::stable_sort(order.begin(), order.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  std::vector<std::string_view> names;
  for (const auto& [provider, pixels] : order) {
    for (const std::string_view name : provider_names(provider)) {
      if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
    }
  }
  sidecar.source = fmt::format("{}", fmt::join(names, kBetweenNames));
}

Findings check_stated_places(std::span<const ImageryInput> inputs) {
  Findings findings;
  for (const ImageryInput& input : inputs) {
    if (input.facts.ce90_m >= input.place_precision_m) continue;
    findings.add({.code = "imagery.coarse_place",
                  .where = input.path.string(),
                  .expected = fmt::format("a CE90 of at least {:.3g} m: the file states its corners no more precisely",
                                          input.place_precision_m),
                  .found = fmt::format("{:.3g} m stated", input.facts.ce90_m),
                  .fix =
                      "state the true one with --ce90-m; or give a file with an exact place: NITF with BLOCKA or RPC, "
                      "orthorectified to a GeoTIFF with gdalwarp"});
  }
  return findings;
}

Findings check_stated_licences(std::span<const ImageryInput> inputs) {
  Findings findings;
  for (const ImageryInput& input : inputs) {
    if (!input.facts.licence.empty()) continue;
    findings.add(
        {.code = "licence.unstated",
         .severity = Severity::warning,
         .where = input.path.string(),
         .expected = "the licence of the imagery: an SPDX identifier such as CC-BY-4.0, or unknown",
         .found = "nothing in the STAC Item, and no --licence",
         .fix = "pass --licence ID, or --licence unknown to say that nobody knows; or add license to the item"});
  }
  return findings;
}

std::vector<SourceLicence> stated_sources(std::span<const Sidecar> tiles, std::span<const ImageryInput> inputs,
                                          std::span<const SourceLicence> known) {
  std::set<std::string_view> named;
  for (const Sidecar& tile : tiles) {
    for (const std::string_view name : provider_names(tile.source)) named.insert(name);
  }
  std::set<SourceLicence> sources;
  for (const SourceLicence& source : known) {
    if (named.contains(source.source)) sources.insert(source);
  }
  for (const ImageryInput& input : inputs) {
    if (input.facts.licence.empty()) continue;
    for (const std::string_view name : provider_names(input.facts.provider)) {
      if (named.contains(name)) sources.insert({std::string(name), input.facts.licence, input.facts.attribution});
    }
  }
  return {sources.begin(), sources.end()};
}

Findings check_stated_resolution(std::span<const ImageryInput> inputs) {
  constexpr double kFinestShare = 0.6;       // of a pixel: rasters are resampled to somewhat larger pixels ...
  constexpr double kImpossibleShare = 0.25;  // ... not to far larger ones
  Findings findings;
  for (const ImageryInput& input : inputs) {
    const double gsd_m = input.facts.gsd_m;
    if (!(input.pixel_m > 0) || gsd_m >= kFinestShare * input.pixel_m) continue;
    findings.add({.code = "resolution.implausible",
                  .severity = gsd_m < kImpossibleShare * input.pixel_m ? Severity::error : Severity::warning,
                  .where = input.path.string(),
                  .expected = fmt::format("about {:.3g} m on the ground: the raster's pixels", input.pixel_m),
                  .found = fmt::format("{:.3g} m stated", gsd_m),
                  .fix = "state the true one: --gsd-m, or gsd in the STAC Item"});
  }
  return findings;
}

std::vector<StacAsset> named_rasters(const std::filesystem::path& named) {
  if (is_remote_name(named.string()) && mounted_object(named) == nullptr) reject_remote(named, named.string());
  if (!is_stac_name(named.string())) return {StacAsset{StacItem::beside(named), {}, named.string()}};
  std::vector<StacAsset> assets = read_stac(named.string());
  for (const StacAsset& asset : assets) {
    if (asset.pin) mount_object(*asset.pin);
    if (asset.pin || !is_remote_name(asset.href)) continue;
    throw UsageError(
        {.what = "an object is not pinned",
         .where = fmt::format("{} in {}", asset.href, asset.item.where()),
         .expected = "file:size, file:checksum (SHA-256), nadir:block_bytes and nadir:block_sha256",
         .fix = fmt::format("nadir cache pin {} > sources.json, and name sources.json in its place", named.string())});
  }
  return assets;
}

std::vector<ImageryInput> open_imagery(std::span<const std::filesystem::path> paths, const ImageryOverrides& overrides,
                                       std::span<const StretchRequest> stretches) {
  if (stretches.size() > 1 && stretches.size() != paths.size()) {
    throw UsageError({.what = "the number of stretches does not match the rasters",
                      .where = "--stretch",
                      .expected = fmt::format("one for all, or {}: one per --imagery", paths.size()),
                      .found = std::to_string(stretches.size()),
                      .fix = "pass --stretch none for a raster that is 8 bit"});
  }
  std::vector<ImageryInput> inputs;
  for (std::size_t i = 0; i < paths.size(); ++i) {
    const StretchRequest request = stretches.empty() ? StretchRequest{} : stretches[stretches.size() == 1 ? 0 : i];
    for (const StacAsset& asset : named_rasters(paths[i])) {
      const std::filesystem::path raster = asset.href;
      const std::optional<Stretch> stretch = resolve_stretch(raster, request);
      const RasterSource source(raster, stretch);
      ImageryInput input{raster, read_imagery_facts(asset.item, overrides), source.outline()};
      input.stretch = stretch;
      input.pixel_m = source.pixel_m();
      input.place_precision_m = source.place_precision_m();
      input.stated_sha256 = asset.sha256;
      if (stretch) input.facts.provider += fmt::format(" ({})", to_text(*stretch));
      inputs.push_back(std::move(input));
    }
  }
  return inputs;
}

}  // namespace nadir
