// `nadir cache pin`: objects and lists of imagery to one list that builds read from.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "base/plural.hpp"
#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "commands/commands.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/pinned_files.hpp"
#include "raster/stac.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

class CachePinCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "pin"; }
  std::string_view summary() const override { return "pin rasters in object storage, so that builds may read them"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  json stated() const;

  std::vector<std::string> sources_;
  std::optional<UtcTime> captured_;
  std::optional<double> gsd_m_, ce90_m_;
  std::optional<std::string> provider_, licence_, attribution_;
};

std::string_view CachePinCommand::details() const {
  return R"(Reads every object once and writes a STAC ItemCollection to standard output: the items, each with its
imagery's size, SHA-256, and the digests of its blocks of 256 KiB. `cache build --imagery LIST.json`,
and the commands that take --imagery as it does, then read of the objects what they need, and verify
every block. The package is the one that copies of the files on this machine would give. A list of
elevation models goes to --dem in the same way; of these nothing needs to be stated.

A SOURCE is the URL of a raster (s3://BUCKET/KEY, gs://, az://, https://, http://), a raster on this
machine, or a STAC Item, ItemCollection, Collection or Catalog (.json, .geojson), here or there. What
an item states of size and checksum is compared. The options state what no item does.

Credentials come from the environment, from ~/.aws/credentials and ~/.aws/config, or from the role of
a machine in a cloud, as GDAL finds them. A URL that holds some is refused, and the list holds none.

Exit codes: 0 pinned; 2 an object cannot be read, is another than its item states, or is no raster.)";
}

std::string_view CachePinCommand::examples() const {
  return R"(nadir cache pin s3://imagery/alps/2026-05.tif --captured 2026-05-03 --gsd-m 0.3 --ce90-m 2 --provider survey --licence CC-BY-4.0 > sources.json
nadir cache pin https://example.org/stac/collection.json --ce90-m 5 > sources.json
nadir cache pin s3://terrain/glo-30/N47E008.tif s3://terrain/glo-30/N47E009.tif > heights.json
nadir cache build --mission mission.yaml --imagery sources.json --dem heights.json --key planner.key.pem --out package)";
}

void CachePinCommand::setup(Options& options) {
  options.values("SOURCE", sources_, "SOURCE", "raster or STAC document, as a URL or a path").required();
  options.value("--captured", captured_, "TIME", "capture time of the imagery, instead of the STAC Item's datetime");
  options.value("--gsd-m", gsd_m_, "METRES", "ground sample distance, instead of the STAC Item's").between(1e-4, 1e4);
  options.value("--ce90-m", ce90_m_, "METRES", "90 % circular error, instead of the STAC Item's").between(1e-4, 1e5);
  options.value("--provider", provider_, "NAME", "provider of the imagery, instead of the STAC Item's");
  options.value("--licence", licence_, "ID",
                "licence of the imagery, instead of the STAC Item's: an SPDX identifier, or unknown");
  options.value("--attribution", attribution_, "TEXT", "what the licence asks to be shown, instead of the STAC Item's");
}

// The options as an item's properties.
json CachePinCommand::stated() const {
  json properties = json::object();
  if (captured_) properties["datetime"] = to_rfc3339(*captured_);
  if (gsd_m_) properties["gsd"] = *gsd_m_;
  if (ce90_m_) properties["nadir:ce90_m"] = *ce90_m_;
  if (provider_) properties["providers"] = json::array({json{{"name", *provider_}}});
  if (licence_) properties["license"] = *licence_;
  if (attribution_) properties["attribution"] = *attribution_;
  return properties;
}

std::string read_document(const ObjectAddress& address) {
  constexpr std::uint64_t kMost_bytes = std::uint64_t{8} << 20;
  const ObjectPart part = object_client()->read(address, 0, kMost_bytes);
  if (part.object_bytes == part.bytes.size()) return std::string(as_text(part.bytes));
  throw UsageError({.what = "this document is too large",
                    .where = address.url,
                    .expected = fmt::format("at most {} bytes", kMost_bytes),
                    .found = fmt::format("{} bytes", part.object_bytes),
                    .fix = "download it, and name the copy"});
}

// A raster without an item.
StacAsset bare_asset(const std::string& href) {
  const std::string key = "data";
  json item = {{"type", "Feature"},
               {"stac_version", "1.0.0"},
               {"id", fs::path(href).stem().string()},
               {"geometry", nullptr},
               {"properties", {{"datetime", nullptr}}},
               {"links", json::array()},
               {"assets", {{key, {{"href", href}, {"roles", json::array({"data"})}}}}}};
  return {StacItem(href, std::move(item)), key, href};
}

std::vector<StacAsset> assets_of(const std::string& source) {
  const bool remote = is_remote_name(source);
  const std::string name = remote ? parse_object_address(source).url : fs::absolute(source).lexically_normal().string();
  if (is_stac_name(name)) return read_stac(name, read_document);
  StacAsset asset = bare_asset(name);
  if (remote || !fs::exists(stac_item_beside(name))) return {std::move(asset)};
  json item = asset.item.document();
  item["properties"] = StacItem::beside(name).document()["properties"];
  asset.item = StacItem(stac_item_beside(name).string(), std::move(item));
  return {std::move(asset)};
}

void require_stated(const StacAsset& asset, std::uint64_t bytes, const Sha256& sha256) {
  const auto refuse = [&asset](std::string expected, std::string found) {
    throw UsageError({.what = "imagery is not the one that its item states",
                      .where = fmt::format("{} in {}", asset.href, asset.item.where()),
                      .expected = std::move(expected),
                      .found = std::move(found),
                      .fix = "ask its provider; or remove file:size and file:checksum from the item, if the new one is "
                             "wanted"});
  };
  if (asset.bytes && *asset.bytes != bytes) {
    refuse(fmt::format("{} bytes", *asset.bytes), fmt::format("{} bytes", bytes));
  }
  if (asset.sha256 && *asset.sha256 != sha256) refuse("sha256 " + asset.sha256->hex(), "sha256 " + sha256.hex());
}

void pin(StacAsset& asset, Progress& progress) {
  if (asset.tiled()) {
    throw UsageError({.what = "tiled assets are not pinned",
                      .where = asset.href,
                      .expected = "rasters that are one file each",
                      .fix = "name the item itself where imagery is named: its tiles are hashed there"});
  }
  if (is_remote_name(asset.href)) {
    const ObjectPin pin = pin_object(*object_client(), parse_object_address(asset.href), progress);
    require_stated(asset, pin.bytes, pin.sha256);
    asset.bytes = pin.bytes, asset.sha256 = pin.sha256, asset.pin = pin;
    mount_object(pin);
  } else {
    asset.href = fs::absolute(asset.href).lexically_normal().string();
    const Sha256 sha256 = sha256_file(asset.href);
    require_stated(asset, fs::file_size(asset.href), sha256);
    asset.bytes = fs::file_size(asset.href), asset.sha256 = sha256;
  }
  open_gdal_raster(asset.href);  // rather now than in the build
}

int CachePinCommand::run(Context& context) {
  std::vector<StacAsset> all;
  std::uint64_t bytes = 0;
  for (const std::string& source : sources_) {
    for (StacAsset& asset : assets_of(source)) {
      pin(asset, context.progress);
      json item = asset.item.document();
      item["properties"].update(stated());
      asset.item = StacItem(asset.item.where(), std::move(item));
      bytes += *asset.bytes;
      all.push_back(std::move(asset));
    }
  }
  context.out << stac_list_json(all);
  if (!context.quiet) {
    context.err << fmt::format("pinned {} of {:.1f} MB\n", count(all.size(), "raster"),
                               static_cast<double>(bytes) / 1e6);
  }
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_cache_pin() { return std::make_unique<CachePinCommand>(); }

}  // namespace nadir
