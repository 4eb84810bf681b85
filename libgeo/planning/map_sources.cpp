#include "planning/map_sources.hpp"

#include <algorithm>
#include <array>
#include <functional>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/json.hpp"
#include "planning/raster_tiles.hpp"
#include "raster/elevation_model.hpp"
#include "raster/imagery_input.hpp"
#include "token_keys/token_key.hpp"
#include "trust/keys.hpp"
#include "trust/root.hpp"
#include "vision/camera.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostFiles = 500;  // of a kind that are listed
constexpr std::array<std::string_view, 6> kRasterEndings{".tif", ".tiff", ".vrt", ".jp2", ".img", ".hgt"};
constexpr std::array<std::string_view, 2> kCameraEndings{".yaml", ".yml"};
constexpr std::array<std::string_view, 7> kVectorEndings{".pbf",      ".osm", ".gpkg", ".geojson",
                                                         ".geojsonl", ".fgb", ".shp"};
constexpr std::string_view kPrivateEnding = ".key.pem", kPublicEnding = ".pub.pem";

using Named = std::pair<std::string, fs::path>;

// The files of the paths, by name; of two files with one name the first.
std::vector<Named> named_files(const std::vector<fs::path>& paths, std::span<const std::string_view> endings) {
  std::vector<Named> files;
  const auto add = [&](const fs::path& file) {
    const std::string name = file.filename().string();
    const bool known = std::any_of(files.begin(), files.end(), [&](const Named& one) { return one.first == name; });
    if (!known && files.size() < kMostFiles) files.emplace_back(name, file);
  };
  for (const fs::path& path : paths) {
    std::error_code code;
    if (fs::is_regular_file(path, code)) add(path);
    if (!fs::is_directory(path, code)) continue;
    std::vector<fs::path> inside;
    for (fs::directory_iterator at(path, code), end; !code && at != end; at.increment(code)) {
      const std::string ending = at->path().extension().string();
      std::error_code unreadable;
      if (std::find(endings.begin(), endings.end(), ending) == endings.end()) continue;
      if (at->is_regular_file(unreadable)) inside.push_back(at->path());
    }
    std::sort(inside.begin(), inside.end());
    for (const fs::path& file : inside) add(file);
  }
  return files;
}

std::optional<fs::path> file_named(const std::vector<Named>& files, std::string_view name) {
  for (const auto& [known, path] : files) {
    if (known == name) return path;
  }
  return std::nullopt;
}

std::string problem_of(const Error& error) {
  const ErrorText& text = error.text();
  std::string problem = text.what;
  if (!text.expected.empty()) problem += "; expected: " + text.expected;
  if (!text.found.empty()) problem += "; found: " + text.found;
  return problem;
}

// What is wrong with a file, in words; "" for nothing.
std::string problem_with(const std::function<void()>& read) {
  try {
    read();
    return {};
  } catch (const Error& error) {
    return problem_of(error);
  }
}

constexpr std::uint64_t kMaxItem = std::uint64_t{1} << 20;

// Whoever reads it is a person: no package depends on it.
std::string licence_of(const fs::path& raster) {
  const fs::path file = stac_item_beside(raster);
  std::error_code code;
  if (!fs::is_regular_file(file, code)) return {};
  const nlohmann::json item =
      parse_json(read_text_file(file, kMaxItem), file.string(), {.max_depth = 32, .allow_floats = true});
  const auto properties = item.find("properties");
  if (properties == item.end() || !properties->is_object() || !properties->contains("license")) return {};
  const nlohmann::json& licence = (*properties)["license"];
  return licence.is_string() ? licence.get<std::string>() : std::string();
}

fs::file_time_type changed_at(const fs::path& file) {
  std::error_code code;
  return fs::last_write_time(file, code);
}

// Of a token's key its URI, without where module and PIN are.
std::string name_of_key(const fs::path& path) {
  const std::string& text = path.native();
  return is_token_uri(text) ? text.substr(0, text.find('?')) : path.filename().string();
}

}  // namespace

// A raster that was opened, or why it cannot be.
struct MapSources::Seen {
  fs::file_time_type raster_changed, item_changed;
  std::shared_ptr<const RasterTiles> tiles;
  ImagerySource source;
};

MapSources::MapSources(MapSourceOptions options) : options_(std::move(options)) {}

std::vector<ImagerySource> MapSources::imagery() const {
  const std::lock_guard lock(mutex_);
  std::vector<ImagerySource> sources;
  for (const auto& [name, path] : named_files(options_.imagery, kRasterEndings)) {
    const auto raster_changed = changed_at(path), item_changed = changed_at(stac_item_beside(path));
    std::shared_ptr<const Seen>& seen = seen_[path];
    if (!seen || seen->raster_changed != raster_changed || seen->item_changed != item_changed) {
      Seen fresh{.raster_changed = raster_changed, .item_changed = item_changed, .tiles = {}, .source = {}};
      ImagerySource& source = fresh.source;
      source.name = name, source.path = path;
      source.problem = problem_with([&] {
        fresh.tiles = std::make_shared<const RasterTiles>(path);
        source.bounds = fresh.tiles->bounds(), source.zooms = fresh.tiles->zooms();
        source.pixel_m = fresh.tiles->pixel_m();
        const ImageryFacts facts = read_imagery_facts(path, {});
        source.captured_at = facts.captured_at, source.provider = facts.provider;
        source.gsd_m = facts.gsd_m, source.ce90_m = facts.ce90_m;
        source.licence = licence_of(path);
      });
      seen = std::make_shared<const Seen>(std::move(fresh));
    }
    sources.push_back(seen->source);
  }
  return sources;
}

std::vector<NamedSource> MapSources::elevation() const {
  std::vector<NamedSource> sources;
  for (const auto& [name, path] : named_files(options_.elevation, kRasterEndings)) {
    sources.push_back({name, path, problem_with([&file = path] { const ElevationModel model(file); })});
  }
  return sources;
}

std::vector<NamedSource> MapSources::cameras() const {
  std::vector<NamedSource> sources;
  for (const auto& [name, path] : named_files(options_.cameras, kCameraEndings)) {
    sources.push_back({name, path, problem_with([&file = path] { read_camera_file(file); })});
  }
  return sources;
}

std::vector<NamedSource> MapSources::vectors() const {
  std::vector<NamedSource> sources;
  for (const auto& [name, path] : named_files(options_.vectors, kVectorEndings)) {
    const std::string ending = path.extension().string();
    const bool stated = options_.vectors_attribution && options_.vectors_licence;
    const bool known = stated || ending == ".pbf" || ending == ".osm";
    sources.push_back({name, path,
                       known ? ""
                             : "whose data this is, and under which licence, is not known; start the desk with "
                               "--vectors-attribution and --vectors-licence"});
  }
  return sources;
}

// The private keys stay closed, and tokens unasked: who they are says the public key beside each.
std::vector<KeySource> MapSources::keys() const {
  std::optional<TrustRoot> root;
  std::string root_problem;
  if (options_.trust) root_problem = problem_with([&] { root = read_trusted_root(*options_.trust); });
  std::vector<KeySource> sources;
  for (const fs::path& path : options_.keys) {
    KeySource source{.name = name_of_key(path), .path = path, .keyid = {}, .appointed = {}, .problem = {}};
    std::string beside = path.string();
    std::error_code code;
    if (!is_token_uri(path.native()) && !fs::is_regular_file(path, code)) source.problem = "no such file";
    if (beside.ends_with(kPrivateEnding)) {
      beside.replace(beside.size() - kPrivateEnding.size(), kPrivateEnding.size(), kPublicEnding);
      if (fs::is_regular_file(beside, code)) {
        const std::string problem = problem_with([&] { source.keyid = PublicKey::read(beside).id(); });
        if (!problem.empty()) source.problem = problem;
      }
    }
    if (root && !source.keyid.empty()) {
      source.appointed = root->package_signer.key_ids.contains(source.keyid) && !root->revoked.contains(source.keyid);
    }
    if (!root_problem.empty()) source.problem = "the root of trust: " + root_problem;
    sources.push_back(std::move(source));
  }
  return sources;
}

std::optional<fs::path> MapSources::imagery_file(std::string_view name) const {
  return file_named(named_files(options_.imagery, kRasterEndings), name);
}
std::optional<fs::path> MapSources::elevation_file(std::string_view name) const {
  return file_named(named_files(options_.elevation, kRasterEndings), name);
}
std::optional<fs::path> MapSources::camera_file(std::string_view name) const {
  return file_named(named_files(options_.cameras, kCameraEndings), name);
}
std::optional<fs::path> MapSources::vectors_file(std::string_view name) const {
  return file_named(named_files(options_.vectors, kVectorEndings), name);
}
std::optional<fs::path> MapSources::key_file(std::string_view name) const {
  for (const fs::path& path : options_.keys) {
    if (name_of_key(path) == name) return path;
  }
  return std::nullopt;
}

std::shared_ptr<const TileSource> MapSources::tiles(std::string_view name) const {
  const auto path = imagery_file(name);
  if (!path) return nullptr;
  {
    const std::lock_guard lock(mutex_);
    const auto seen = seen_.find(*path);
    if (seen != seen_.end() && seen->second->raster_changed == changed_at(*path)) return seen->second->tiles;
  }
  imagery();
  const std::lock_guard lock(mutex_);
  return seen_.at(*path)->tiles;
}

}  // namespace nadir
