#include "raster/tile_package.hpp"

#include <cpl_conv.h>
#include <cpl_string.h>
#include <cpl_vsi.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/json.hpp"
#include "base/number_text.hpp"
#include "raster/gdal_dataset.hpp"

namespace nadir {
namespace {

constexpr std::uint64_t kMaxRoot_bytes = std::uint64_t{4} << 20;
constexpr std::uint64_t kMaxTile_bytes = std::uint64_t{16} << 20;
constexpr std::uint64_t kMaxBundle_bytes = std::uint64_t{4}
                                           << 30;  // an archive may promise more than anybody can inflate
constexpr std::size_t kMaxTiles = std::size_t{1} << 24;
constexpr std::size_t kBundleHead_bytes = 64;
constexpr std::uint32_t kBundleSide = 128;  // tiles
constexpr double kSame = 1e-6;              // relative difference of resolutions that are the same, as text has them

struct CloseFile {
  void operator()(VSILFILE* file) const { VSIFCloseL(file); }
};
using FileInArchive = std::unique_ptr<VSILFILE, CloseFile>;

std::string in_archive(const std::string& path, const std::string& name) {
  return fmt::format("/vsizip/{{{}}}/{}", path, name);
}

std::optional<Bytes> read_part(VSILFILE* file, std::uint64_t at, std::size_t size) {
  Bytes bytes(size);
  if (VSIFSeekL(file, at, SEEK_SET) != 0 || VSIFReadL(bytes.data(), 1, size, file) != size) return std::nullopt;
  return bytes;
}

std::uint64_t number_at(const Bytes& bytes, std::size_t at) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < 8; ++i) value |= std::uint64_t{bytes[at + i]} << (8 * i);
  return value;
}

// "R8000C10c00.bundle": row and column of its first tile.
std::optional<std::array<std::uint32_t, 2>> first_tile_of(std::string_view name) {
  constexpr std::string_view kEnd = ".bundle";
  if (!name.starts_with('R') || !name.ends_with(kEnd)) return std::nullopt;
  name.remove_prefix(1), name.remove_suffix(kEnd.size());
  const std::size_t letter = name.find('C');
  if (letter == std::string_view::npos) return std::nullopt;
  std::array<std::uint32_t, 2> numbers{};
  const std::array parts = {name.substr(0, letter), name.substr(letter + 1)};
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const auto number = whole_number<std::uint32_t>(parts[i], 16);
    if (!number || *number % kBundleSide != 0) return std::nullopt;
    numbers[i] = *number;
  }
  return numbers;
}

}  // namespace

struct TilePackageReader::OpenBundle {
  std::uint32_t number;
  FileInArchive file;
};

TilePackageReader::TilePackageReader(const InputFile& file) : path_(file.path().string()) {
  const QuietGdal quiet;
  read_root();
  // The finest level that has tiles: levels are planned before they are filled.
  std::vector<std::size_t> order(levels_.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return zooms_[a] > zooms_[b]; });
  for (std::size_t i = 0; i < order.size() && entries_.empty(); ++i) {
    zoom_ = zooms_[order[i]];
    read_level(levels_[order[i]]);
  }
  if (entries_.empty()) refuse("its bundles", "tiles", "none");
  std::sort(entries_.begin(), entries_.end(), [](const Entry& a, const Entry& b) { return a.key < b.key; });
}

TilePackageReader::~TilePackageReader() = default;

void TilePackageReader::refuse(const std::string& where, std::string expected, std::string found) const {
  throw Error({.what = "this Esri tile package cannot be read",
               .where = fmt::format("{} ({})", path_, where),
               .expected = std::move(expected),
               .found = std::move(found),
               .fix = "convert it with GDAL 3.7 or later: gdal_translate -of COG IN.tpkx OUT.tif"});
}

void TilePackageReader::read_root() {
  const FileInArchive file(VSIFOpenL(in_archive(path_, "root.json").c_str(), "rb"));
  if (!file) refuse("the archive", "a complete ZIP archive with root.json", QuietGdal::last_error());
  VSIFSeekL(file.get(), 0, SEEK_END);
  const std::uint64_t size = VSIFTellL(file.get());
  if (size > kMaxRoot_bytes) refuse("root.json", fmt::format("at most {} bytes", kMaxRoot_bytes), std::to_string(size));
  const std::optional<Bytes> text = read_part(file.get(), 0, size);
  if (!text) refuse("root.json", fmt::format("{} bytes", size), "fewer");

  const std::string name = path_ + " (root.json)";
  const nlohmann::json document = parse_json(as_text(*text), name);
  const JsonReader in(document, {.name = name, .what = "this Esri tile package cannot be read"});
  folder_ = in.optional_text("tileBundlesPath", {.least = 1, .most = 256}).value_or("tile");
  const JsonReader storage = in.object("storageInfo");
  storage.expect("storageFormat", "esriMapCacheStorageModeCompactV2");
  storage.integer("packetSize", kBundleSide, kBundleSide);
  const JsonReader scheme = in.object("tileInfo");
  const auto side = scheme.integer<int>("rows", kTileSize, 2 * kTileSize);
  scheme.integer<int>("cols", side, side);
  if (side % kTileSize != 0) scheme.refuse("rows", "256 or 512");
  const JsonReader system = scheme.object("spatialReference");
  const auto wkid = system.optional_integer<int>("latestWkid", 0, 1'000'000);
  if (wkid ? *wkid != 3857 : system.integer<int>("wkid", 0, 1'000'000) != 102100) {
    system.refuse("3857, Web Mercator");
  }
  const JsonReader origin = scheme.object("origin");
  if (std::abs(origin.number("x") + kMercatorHalfWorld_m) > 1 ||
      std::abs(origin.number("y") - kMercatorHalfWorld_m) > 1) {
    origin.refuse("the north-western corner of web maps");
  }
  const JsonReader levels = scheme.array("lods", {.least = 1, .most = 100});
  for (std::size_t i = 0; i < levels.size(); ++i) {
    const JsonReader level = levels.object(i);
    const double zoom = std::log2(2 * kMercatorHalfWorld_m / (level.number("resolution", 1e-6, 1e6) * side));
    if (std::abs(zoom - std::round(zoom)) > kSame || zoom < -0.5 || zoom > kMaxZoom + 0.5) {
      level.refuse("resolution", "that of a zoom of web maps");
    }
    levels_.push_back(level.integer<int>("level", 0, 99));
    zooms_.push_back(static_cast<int>(std::lround(zoom)));
  }
}

void TilePackageReader::read_level(int level) {
  const std::string folder = fmt::format("{}/L{:02}", folder_, level);
  const std::unique_ptr<char*, decltype(&CSLDestroy)> names(VSIReadDir(in_archive(path_, folder).c_str()), &CSLDestroy);
  for (int i = 0; i < CSLCount(names.get()); ++i) {
    const auto first = first_tile_of(names.get()[i]);
    if (!first) continue;
    bundles_.push_back(folder + "/" + names.get()[i]);
    read_index(static_cast<std::uint32_t>(bundles_.size() - 1), (*first)[0], (*first)[1]);
  }
}

void TilePackageReader::read_index(std::uint32_t bundle, std::uint32_t first_row, std::uint32_t first_column) {
  constexpr std::size_t kTiles = std::size_t{kBundleSide} * kBundleSide;
  const std::string& name = bundles_[bundle];
  VSILFILE* file = opened(bundle).file.get();
  VSIFSeekL(file, 0, SEEK_END);
  const std::uint64_t size = VSIFTellL(file);
  if (size > kMaxBundle_bytes) refuse(name, fmt::format("at most {} bytes", kMaxBundle_bytes), std::to_string(size));
  const std::optional<Bytes> index = read_part(file, kBundleHead_bytes, 8 * kTiles);
  if (!index) refuse(name, fmt::format("a head and an index, {} bytes", kBundleHead_bytes + 8 * kTiles), "fewer");
  const std::uint64_t across = std::uint64_t{1} << zoom_;
  for (std::size_t i = 0; i < kTiles; ++i) {
    const std::uint64_t value = number_at(*index, 8 * i);
    const std::uint64_t at = value & ((std::uint64_t{1} << 40) - 1), bytes = value >> 40;
    if (bytes == 0) continue;
    const std::uint64_t row = first_row + i / kBundleSide, column = first_column + i % kBundleSide;
    if (row >= across || column >= across || at > size || bytes > size - at || bytes > kMaxTile_bytes ||
        entries_.size() == kMaxTiles) {
      refuse(fmt::format("{}, tile {}", name, i), "bytes inside the bundle, and an address of its level",
             fmt::format("{} bytes from {} on, of {}", bytes, at, size));
    }
    entries_.push_back(
        {{static_cast<std::uint8_t>(zoom_), static_cast<std::uint32_t>(column), static_cast<std::uint32_t>(row)},
         bundle,
         static_cast<std::uint32_t>(bytes),
         at});
  }
}

TilePackageReader::OpenBundle& TilePackageReader::opened(std::uint32_t bundle) const {
  if (open_ && open_->number == bundle) return *open_;
  FileInArchive file(VSIFOpenL(in_archive(path_, bundles_[bundle]).c_str(), "rb"));
  if (!file) refuse(bundles_[bundle], "a file in the archive", QuietGdal::last_error());
  open_ = std::make_unique<OpenBundle>(bundle, std::move(file));
  return *open_;
}

std::optional<Bytes> TilePackageReader::read(const TileKey& key) const {
  const auto found = std::lower_bound(entries_.begin(), entries_.end(), key,
                                      [](const Entry& entry, const TileKey& wanted) { return entry.key < wanted; });
  if (found == entries_.end() || found->key != key) return std::nullopt;
  const QuietGdal quiet;
  std::optional<Bytes> bytes = read_part(opened(found->bundle).file.get(), found->at, found->size);
  if (!bytes) refuse(bundles_[found->bundle], fmt::format("the tile {}", to_text(key)), QuietGdal::last_error());
  return bytes;
}

std::vector<TileKey> TilePackageReader::keys() const {
  std::vector<TileKey> keys;
  keys.reserve(entries_.size());
  for (const Entry& entry : entries_) keys.push_back(entry.key);
  return keys;
}

}  // namespace nadir
