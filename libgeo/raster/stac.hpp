// SpatioTemporal Asset Catalogs (stacspec.org 1.0) as what is known of imagery, and as lists of it.
//
// An Item states when, by whom, how finely and how accurately imagery was made, and under which licence: beside a
// raster (map.tif, map.json), or in a list. A list is an Item, an ItemCollection (a GeoJSON FeatureCollection of
// items), or a Collection or Catalog that links to items; its first item lies on top. What an item does not state of
// licence and providers is its Collection's.
//
// The imagery is the asset with the role "visual" or "data", or the only one; its href is a file on this machine,
// relative to the document, or the URL of an object. An item may name a template of tiles instead (tiled_assets.hpp);
// it is a document of its own, and its imagery the document. STAC's file extension (file:size, file:checksum: a
// multihash) states which bytes it is. For an object these are not enough, because a build reads parts of it: besides,
// nadir:block_bytes and nadir:block_sha256 hold the digests of its blocks (object_storage/pinned_object.hpp).
// `nadir cache pin` writes them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/digest.hpp"
#include "base/time.hpp"
#include "object_storage/pinned_object.hpp"

namespace nadir {

class JsonReader;

std::filesystem::path stac_item_beside(const std::filesystem::path& raster);

// What an item states. Each throws UsageError for a value of another type; the first four also when there is none, and
// then name the option that states it instead.
class StacItem {
 public:
  static StacItem beside(const std::filesystem::path& raster);  // states nothing where there is no such file
  StacItem(std::string where, nlohmann::json item);

  UtcTime captured_at() const;  // datetime; of an interval its beginning
  double gsd_m() const;
  double ce90_m() const;
  std::string provider() const;
  std::string optional_text(std::string_view property) const;  // empty when the item does not say

  const std::string& where() const { return where_; }
  const nlohmann::json& document() const { return *item_; }  // null when there is none

 private:
  nlohmann::json property(std::string_view name) const;
  double positive(std::string_view name, std::string_view fact, std::string_view option) const;
  [[noreturn]] void missing(std::string_view fact, std::string_view option) const;
  [[noreturn]] void reject(std::string_view name, std::string_view expected, const nlohmann::json& found) const;

  std::string where_;
  std::shared_ptr<const nlohmann::json> item_;
};

// The imagery of one item.
struct StacAsset {
  StacItem item;
  std::string key;   // of the asset
  std::string href;  // path of a file, or URL of an object
  std::optional<std::uint64_t> bytes{};
  std::optional<Sha256> sha256{};  // nothing when the checksum is of another kind
  std::optional<ObjectPin> pin{};  // of an object, when it is stated completely

  bool tiled() const;  // many files; href is the item
};

bool is_stac_name(std::string_view path_or_url);  // ends in .json or .geojson

// Reads a document that lies elsewhere. A build reads none: its result depends on files on this machine, and pins.
using ReadRemoteText = std::function<std::string(const ObjectAddress&)>;

// All imagery of the list, in its order. Throws UsageError when it is none, or names none. A document from elsewhere
// may name nothing on this machine.
std::vector<StacAsset> read_stac(const std::string& path_or_url, const ReadRemoteText& read_remote = {});

// Which of an item's assets, or templates of tiles, is the imagery. Throws JsonError when that is not clear.
std::string imagery_asset_key(const JsonReader& assets);

// The assets, none of them tiled, as one ItemCollection, each item with this asset alone, and with the file extension's
// fields.
std::string stac_list_json(const std::vector<StacAsset>& assets);

}  // namespace nadir
