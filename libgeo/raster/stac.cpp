#include "raster/stac.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/json.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr int kMaxDepth = 32;                                     // of nested JSON
constexpr std::uint64_t kMaxList_bytes = std::uint64_t{1} << 29;  // of a document: a million km² of block digests
constexpr std::size_t kMaxDocuments = 100'000;                    // that one list leads to
constexpr int kMaxLinks = 4;                                      // from a catalogue down to an item
constexpr std::string_view kSha256Multihash = "1220";             // SHA-256, 32 bytes
constexpr const char* kFileExtension = "https://stac-extensions.github.io/file/v2.1.0/schema.json";
constexpr const char* kTemplates = "asset_templates";  // of the tiled assets extension
constexpr const char* kSee = "see docs/commands/cache-build.md for an example";

bool is_text(const json& value, std::string_view text) { return value.is_string() && value.get<std::string>() == text; }

}  // namespace

fs::path stac_item_beside(const fs::path& raster) {
  fs::path item = raster;
  return item.replace_extension(".json");
}

StacItem::StacItem(std::string where, json item) : where_(std::move(where)) {
  if (!item.is_null() && (!item.is_object() || !is_text(item.value("type", json()), "Feature") ||
                          !item.contains("properties") || !item["properties"].is_object())) {
    throw UsageError({.what = "this is not a STAC Item",
                      .where = where_,
                      .expected = "a GeoJSON Feature with properties",
                      .fix = kSee});
  }
  item_ = std::make_shared<const nlohmann::json>(std::move(item));
}

StacItem StacItem::beside(const fs::path& raster) {
  const fs::path file = stac_item_beside(raster);
  if (!fs::exists(file)) return {file.string(), nullptr};
  return {file.string(), parse_json(read_text_file(file), file.string(), {.max_depth = kMaxDepth})};
}

void StacItem::missing(std::string_view fact, std::string_view option) const {
  throw UsageError(
      {.what = fmt::format("the imagery's {} is unknown", fact),
       .where = where_,
       .expected = fmt::format("a STAC Item that states it, beside the raster or in a list, or {}", option),
       .found = item_->is_null() ? "no such file" : "an item without it",
       .fix = fmt::format("add it to the item, or pass {}", option)});
}

void StacItem::reject(std::string_view name, std::string_view expected, const nlohmann::json& found) const {
  throw UsageError({.what = "the STAC Item is invalid",
                    .where = fmt::format("{} (properties.{})", where_, name),
                    .expected = std::string(expected),
                    .found = found.dump().substr(0, 200)});
}

json StacItem::property(std::string_view name) const {
  if (item_->is_null()) return {};
  const json& properties = item_->at("properties");
  const auto found = properties.find(name);
  return found == properties.end() ? json() : *found;
}

double StacItem::positive(std::string_view name, std::string_view fact, std::string_view option) const {
  const nlohmann::json value = property(name);
  if (value.is_null()) missing(fact, option);
  if (!value.is_number() || value.get<double>() <= 0) reject(name, "a positive number of metres", value);
  return value.get<double>();
}

double StacItem::gsd_m() const { return positive("gsd", "ground sample distance", "--gsd-m"); }
double StacItem::ce90_m() const { return positive("nadir:ce90_m", "accuracy (CE90)", "--ce90-m"); }

UtcTime StacItem::captured_at() const {
  const char* const name = property("datetime").is_null() ? "start_datetime" : "datetime";
  const nlohmann::json value = property(name);
  if (value.is_null()) missing("capture time", "--captured");
  const auto time = value.is_string() ? parse_utc(value.get<std::string>()) : std::nullopt;
  if (!time) reject(name, "an RFC 3339 time", value);
  return *time;
}

std::string StacItem::provider() const {
  const nlohmann::json value = property("providers");
  if (!value.is_array() || value.empty() || !value[0].is_object() || !value[0].contains("name")) {
    missing("provider", "--provider");
  }
  if (!value[0]["name"].is_string()) reject("providers[0].name", "a string", value[0]["name"]);
  return value[0]["name"].get<std::string>();
}

std::string StacItem::optional_text(std::string_view name) const {
  const nlohmann::json value = property(name);
  if (value.is_null()) return {};
  if (!value.is_string()) reject(name, "a string", value);
  return value.get<std::string>();
}

bool is_stac_name(std::string_view path_or_url) {
  return path_or_url.ends_with(".json") || path_or_url.ends_with(".geojson");
}

namespace {

// What an href of a document means. A document from elsewhere cannot name a file on this machine: all that it names
// without a scheme lies on its own server.
std::string resolve(const std::string& document, const std::string& href) {
  if (is_remote_name(href)) return parse_object_address(href).url;
  if (!is_remote_name(document)) return (fs::path(document).parent_path() / href).lexically_normal().string();
  const std::size_t host = document.find("://") + 3;
  const std::size_t path = document.find('/', host);
  const fs::path target = (fs::path(document.substr(path)).parent_path() / href).lexically_normal();
  return parse_object_address(document.substr(0, path) + target.string()).url;
}

// The file extension's fields, and ours.
StacAsset stated_asset(const JsonReader& in, StacItem item, std::string key, const std::string& document) {
  StacAsset asset{std::move(item), std::move(key), resolve(document, in.text("href", {.least = 1, .most = 4096}))};
  constexpr std::int64_t kMostBytes = std::int64_t{1} << 50;
  asset.bytes = in.optional_integer<std::uint64_t>("file:size", 1, kMostBytes);
  if (const auto checksum = in.optional_text("file:checksum", {.most = 1024}); checksum) {
    if (checksum->starts_with(kSha256Multihash)) {
      asset.sha256 = Sha256::from_hex(std::string_view(*checksum).substr(kSha256Multihash.size()));
      if (!asset.sha256) in.refuse("file:checksum", "the multihash of a SHA-256: 1220 and 64 hexadecimal digits");
    }
  }
  const auto block_bytes = in.optional_integer<std::uint64_t>("nadir:block_bytes", 1, kMostBytes);
  const auto blocks = in.optional_text("nadir:block_sha256");
  if (!block_bytes || !blocks || !asset.bytes || !asset.sha256 || !is_remote_name(asset.href)) return asset;
  auto digests = parse_blocks(*blocks, *asset.bytes, *block_bytes);
  if (!digests) {
    in.refuse("nadir:block_sha256",
              fmt::format("base64 of a SHA-256 for each of the object's blocks of {} bytes", *block_bytes),
              "other text");
  }
  asset.pin =
      ObjectPin{parse_object_address(asset.href), *asset.bytes, *asset.sha256, *block_bytes, *std::move(digests)};
  return asset;
}

bool has_role(const json& asset, std::string_view role) {
  const auto roles = asset.find("roles");
  return roles != asset.end() && roles->is_array() &&
         std::any_of(roles->begin(), roles->end(), [role](const json& one) { return is_text(one, role); });
}

}  // namespace

bool StacAsset::tiled() const { return item.document().is_object() && item.document().contains(kTemplates); }

std::string imagery_asset_key(const JsonReader& assets) {
  const std::vector<std::string> keys = assets.keys();
  for (const std::string_view role : {"visual", "data"}) {
    std::vector<std::string> with_role;
    for (const std::string& key : keys) {
      if (assets.json()[key].is_object() && has_role(assets.json()[key], role)) with_role.push_back(key);
    }
    if (with_role.size() == 1) return with_role.front();
    if (with_role.size() > 1) {
      assets.refuse(fmt::format("one asset with the role {}, found {}", role, fmt::join(with_role, ", ")));
    }
  }
  if (keys.size() == 1) return keys.front();
  assets.refuse("one asset, or one with the role visual or data");
}

namespace {

class ListReader {
 public:
  explicit ListReader(const ReadRemoteText& read_remote) : read_remote_(read_remote) {}

  void read(const std::string& name, const json& collection, int links) {
    if (links > kMaxLinks || seen_.size() >= kMaxDocuments) {
      throw UsageError({.what = "this list leads to too many documents",
                        .where = name,
                        .expected = fmt::format("at most {}, not more than {} links deep", kMaxDocuments, kMaxLinks)});
    }
    if (!seen_.insert(name).second) return;  // one that links to itself
    const json document = parse_json(text_of(name), name, {.max_depth = kMaxDepth});
    const JsonReader in(document, {.name = name, .what = "this is no list of imagery", .fix = kSee});
    const std::string& type = in.text("type");
    if (type == "Feature") {
      add_item(name, name, document, collection);
    } else if (type == "FeatureCollection") {
      const JsonReader features = in.array("features");
      for (std::size_t i = 0; i < features.size(); ++i) {
        add_item(name, features.where(i), features.object(i).json(), collection);
      }
    } else if (type == "Collection" || type == "Catalog") {
      follow_links(name, in, type == "Collection" ? document : collection, links);
    } else {
      in.refuse("type", "Feature, FeatureCollection, Collection or Catalog");
    }
  }

  std::vector<StacAsset> take() { return std::move(assets_); }

 private:
  std::string text_of(const std::string& name) const {
    if (!is_remote_name(name)) return read_text_file(name, kMaxList_bytes);
    if (read_remote_) return read_remote_(parse_object_address(name));
    throw UsageError({.what = "a list of imagery names a document that is not on this machine",
                      .where = name,
                      .expected = "files on this machine, and pinned objects",
                      .fix = "nadir cache pin LIST > sources.json, which reads it once, and --imagery sources.json"});
  }

  void follow_links(const std::string& name, const JsonReader& in, const json& collection, int links) {
    const JsonReader list = in.array("links");
    for (std::size_t i = 0; i < list.size(); ++i) {
      const JsonReader link = list.object(i);
      const std::string& relation = link.text("rel");
      if (relation == "item" || relation == "child") {
        read(resolve(name, link.text("href", {.least = 1, .most = 4096})), collection, links + 1);
      }
    }
  }

  void add_item(const std::string& document, const std::string& where, json item, const json& collection) {
    if (collection.is_object() && item.contains("properties") && item["properties"].is_object()) {
      for (const char* const inherited : {"license", "providers"}) {
        if (collection.contains(inherited) && !item["properties"].contains(inherited)) {
          item["properties"][inherited] = collection[inherited];
        }
      }
    }
    const StacItem stated(where, std::move(item));
    if (stated.document().contains(kTemplates)) {
      if (is_remote_name(document) || where != document) {
        throw UsageError(
            {.what = "these tiled assets cannot be read",
             .where = where,
             .expected = "an item that is a document of its own, on this machine, beside its tiles",
             .found = where == document ? "one on a server" : "one item of several",
             .fix = "copy it and its tiles to this machine, and name it, or link to it from a Collection"});
      }
      assets_.push_back({stated, {}, document});
      return;
    }
    const JsonReader in(stated.document(), {.name = where, .what = "this STAC Item names no imagery", .fix = kSee});
    const JsonReader assets = in.object("assets");
    const std::string key = imagery_asset_key(assets);
    assets_.push_back(stated_asset(assets.object(key), stated, key, document));
  }

  const ReadRemoteText& read_remote_;
  std::set<std::string> seen_;
  std::vector<StacAsset> assets_;
};

}  // namespace

std::vector<StacAsset> read_stac(const std::string& path_or_url, const ReadRemoteText& read_remote) {
  ListReader list(read_remote);
  list.read(path_or_url, {}, 0);
  std::vector<StacAsset> assets = list.take();
  if (assets.empty()) {
    throw UsageError({.what = "this list names no imagery",
                      .where = path_or_url,
                      .expected = "a STAC Item, ItemCollection, or Collection with links to items",
                      .found = "no item",
                      .fix = kSee});
  }
  return assets;
}

std::string stac_list_json(const std::vector<StacAsset>& assets) {
  json features = json::array();
  for (const StacAsset& asset : assets) {
    json item = asset.item.document();
    json file = item["assets"][asset.key];
    file["href"] = asset.href;
    if (asset.bytes) file["file:size"] = *asset.bytes;
    if (asset.sha256) file["file:checksum"] = std::string(kSha256Multihash) + asset.sha256->hex();
    if (asset.pin) {
      file["nadir:block_bytes"] = asset.pin->block_bytes;
      file["nadir:block_sha256"] = blocks_text(*asset.pin);
    }
    item["assets"] = json::object({{asset.key, std::move(file)}});
    item["links"] = json::array();
    item.erase("collection");
    json& extensions = item["stac_extensions"];
    if (!extensions.is_array()) extensions = json::array();
    if (std::find(extensions.begin(), extensions.end(), kFileExtension) == extensions.end()) {
      extensions.push_back(kFileExtension);
    }
    features.push_back(std::move(item));
  }
  return json{{"type", "FeatureCollection"}, {"features", std::move(features)}}.dump(1) + '\n';
}

}  // namespace nadir
