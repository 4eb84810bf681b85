#include "imagery/pmtiles.hpp"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace {

constexpr std::size_t kHeader_bytes = 127;
constexpr std::size_t kFirstPart_bytes = 16'384;  // header and root
constexpr std::size_t kMostInRoot = 16'384;       // entries; more of them never fit
constexpr std::size_t kFirstLeaf_entries = 4096;
constexpr std::uint64_t kMaxEntries = std::uint64_t{1} << 24;
constexpr std::uint64_t kMaxMetadata_bytes = std::uint64_t{1} << 24;
constexpr std::uint64_t kMaxTile_bytes = std::uint64_t{64} << 20;
constexpr std::uint64_t kEntry_bytes = 5 + 10 + 5 + 10;  // at most, as numbers of variable length
constexpr int kMaxDepth = 4;                             // of directories

enum Compression : std::uint8_t { kNone = 1, kGzip = 2 };
enum TileType : std::uint8_t { kPng = 2, kJpeg = 3, kWebp = 4 };

// Ids of zooms above.
constexpr std::uint64_t first_id(int zoom) { return ((std::uint64_t{1} << (2 * zoom)) - 1) / 3; }

// A step of the Hilbert curve's recursion: the quadrant is turned so that the curve is continuous.
void turn(std::uint64_t side, std::uint64_t right, std::uint64_t low, std::uint64_t& x, std::uint64_t& y) {
  if (low != 0) return;
  if (right != 0) x = side - 1 - x, y = side - 1 - y;
  std::swap(x, y);
}

void put_number(Bytes& out, std::uint64_t value) {
  for (; value >= 0x80; value >>= 7) out.push_back(static_cast<std::uint8_t>(value | 0x80));
  out.push_back(static_cast<std::uint8_t>(value));
}

void put_le(Bytes& out, std::uint64_t value, int bytes) {
  for (int i = 0; i < bytes; ++i) out.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}

std::uint64_t le_at(ByteView bytes, std::size_t at, int size) {
  std::uint64_t value = 0;
  for (int i = 0; i < size; ++i) value |= std::uint64_t{bytes[at + static_cast<std::size_t>(i)]} << (8 * i);
  return value;
}

// Without a time or a name, so that equal bytes give equal ones.
Bytes gzip(ByteView bytes) {
  z_stream stream{};
  if (deflateInit2(&stream, Z_BEST_COMPRESSION, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY) != Z_OK) {
    throw std::bad_alloc();
  }
  Bytes out(deflateBound(&stream, static_cast<uLong>(bytes.size())));
  stream.next_in = const_cast<Bytef*>(bytes.data());
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = out.data();
  stream.avail_out = static_cast<uInt>(out.size());
  const int result = deflate(&stream, Z_FINISH);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  if (result != Z_STREAM_END) throw Error({.what = "cannot compress a directory of tiles"});
  return out;
}

struct DirectoryEntry {
  std::uint64_t id = 0;
  std::uint64_t at = 0;  // in the tiles, or in the leaves
  std::uint32_t size = 0;
  std::uint32_t run = 0;  // 0: names a leaf
};

Bytes directory_bytes(std::span<const DirectoryEntry> entries) {
  Bytes out;
  put_number(out, entries.size());
  std::uint64_t last = 0;
  for (const DirectoryEntry& entry : entries) {
    put_number(out, entry.id - last);
    last = entry.id;
  }
  for (const DirectoryEntry& entry : entries) put_number(out, entry.run);
  for (const DirectoryEntry& entry : entries) put_number(out, entry.size);
  std::uint64_t end = 0;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    put_number(out, i > 0 && entries[i].at == end ? 0 : entries[i].at + 1);
    end = entries[i].at + entries[i].size;
  }
  return gzip(out);
}

struct Directories {
  Bytes root, leaves;
};

Directories make_directories(std::span<const DirectoryEntry> entries) {
  Directories made;
  if (entries.size() <= kMostInRoot) {
    made.root = directory_bytes(entries);
    if (kHeader_bytes + made.root.size() <= kFirstPart_bytes) return made;
  }
  for (std::size_t leaf = kFirstLeaf_entries;; leaf *= 2) {
    made.leaves.clear();
    std::vector<DirectoryEntry> root;
    for (std::size_t at = 0; at < entries.size(); at += leaf) {
      const auto part = entries.subspan(at, std::min(leaf, entries.size() - at));
      const Bytes bytes = directory_bytes(part);
      root.push_back({part.front().id, made.leaves.size(), static_cast<std::uint32_t>(bytes.size()), 0});
      made.leaves.insert(made.leaves.end(), bytes.begin(), bytes.end());
    }
    made.root = directory_bytes(root);
    if (kHeader_bytes + made.root.size() <= kFirstPart_bytes) return made;
  }
}

std::uint8_t type_of(ImageFormat format) {
  switch (format) {
    case ImageFormat::jpeg: return kJpeg;
    case ImageFormat::png: return kPng;
    case ImageFormat::webp: return kWebp;
  }
  return kPng;
}

// The numbers of variable length that a directory consists of.
class Numbers {
 public:
  explicit Numbers(ByteView bytes) : bytes_(bytes) {}

  std::optional<std::uint64_t> next(std::uint64_t most) {
    std::uint64_t value = 0;
    for (int shift = 0; shift < 64 && at_ < bytes_.size(); shift += 7) {
      const std::uint8_t byte = bytes_[at_++];
      value |= std::uint64_t{byte & 0x7FU} << shift;
      if (byte < 0x80) return value <= most ? std::optional(value) : std::nullopt;
    }
    return std::nullopt;
  }
  std::size_t left() const { return bytes_.size() - at_; }

 private:
  ByteView bytes_;
  std::size_t at_ = 0;
};

}  // namespace

std::uint64_t pmtiles_id(const TileKey& key) {
  std::uint64_t along = 0, x = key.x, y = key.y;
  for (std::uint64_t side = std::uint64_t{1} << key.z >> 1; side > 0; side /= 2) {
    const std::uint64_t right = (x & side) != 0 ? 1 : 0, low = (y & side) != 0 ? 1 : 0;
    along += side * side * ((3 * right) ^ low);
    x &= side - 1, y &= side - 1;
    turn(side, right, low, x, y);
  }
  return first_id(key.z) + along;
}

std::optional<TileKey> tile_of_pmtiles_id(std::uint64_t id) {
  int zoom = 0;
  while (zoom <= kMaxZoom && id >= first_id(zoom + 1)) ++zoom;
  if (zoom > kMaxZoom) return std::nullopt;
  std::uint64_t along = id - first_id(zoom), x = 0, y = 0;
  for (std::uint64_t side = 1; side < std::uint64_t{1} << zoom; side *= 2) {
    const std::uint64_t right = 1 & (along / 2), low = 1 & (along ^ right);
    turn(side, right, low, x, y);
    x += side * right, y += side * low;
    along /= 4;
  }
  return TileKey{static_cast<std::uint8_t>(zoom), static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y)};
}

PmtilesCounts write_pmtiles(const std::filesystem::path& path, std::vector<PmtilesTile> tiles,
                            const PmtilesFacts& facts, const std::function<Bytes(const TileKey&)>& read,
                            const std::function<void()>& written) {
  if (std::filesystem::exists(path)) throw Error({.what = "the output exists already", .where = path});
  std::sort(tiles.begin(), tiles.end(),
            [](const PmtilesTile& a, const PmtilesTile& b) { return pmtiles_id(a.key) < pmtiles_id(b.key); });
  std::map<Sha256, std::uint64_t> places;  // of contents
  std::vector<DirectoryEntry> entries;
  std::vector<std::size_t> contents;  // the first tile of each
  std::uint64_t data_bytes = 0;
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    const PmtilesTile& tile = tiles[i];
    const std::uint64_t id = pmtiles_id(tile.key);
    if (i > 0 && tiles[i - 1].key == tile.key) {
      throw Error({.what = "a tile is there twice", .where = "tile " + to_text(tile.key)});
    }
    const auto [place, is_new] = places.emplace(tile.sha256, data_bytes);
    if (is_new) {
      contents.push_back(i);
      data_bytes += tile.size;
    }
    if (!entries.empty() && entries.back().id + entries.back().run == id && entries.back().at == place->second &&
        entries.back().size == tile.size) {
      ++entries.back().run;
    } else {
      entries.push_back({id, place->second, tile.size, 1});
    }
  }
  if (entries.empty()) throw Error({.what = "there are no tiles to write", .where = path});
  const Directories directories = make_directories(entries);
  const Bytes metadata = gzip(as_bytes(facts.metadata));

  const auto e7 = [](double degrees) { return static_cast<std::uint32_t>(std::lround(degrees * 1e7)); };
  const LonLatBox& box = facts.bounds;
  const std::uint64_t root_at = kHeader_bytes, metadata_at = root_at + directories.root.size(),
                      leaves_at = metadata_at + metadata.size(), data_at = leaves_at + directories.leaves.size();
  Bytes header(kPmtilesMagic.begin(), kPmtilesMagic.end());
  for (const std::uint64_t value :
       {root_at, std::uint64_t{directories.root.size()}, metadata_at, std::uint64_t{metadata.size()}, leaves_at,
        std::uint64_t{directories.leaves.size()}, data_at, data_bytes, std::uint64_t{tiles.size()},
        std::uint64_t{entries.size()}, std::uint64_t{contents.size()}}) {
    put_le(header, value, 8);
  }
  const auto [coarsest, finest] = std::minmax_element(
      tiles.begin(), tiles.end(), [](const PmtilesTile& a, const PmtilesTile& b) { return a.key.z < b.key.z; });
  header.insert(header.end(), {1 /* clustered */, kGzip, kNone, type_of(facts.format), coarsest->key.z, finest->key.z});
  for (const double degrees : {box.west_deg, box.south_deg, box.east_deg, box.north_deg})
    put_le(header, e7(degrees), 4);
  header.push_back(coarsest->key.z);
  put_le(header, e7((box.west_deg + box.east_deg) / 2), 4);
  put_le(header, e7((box.south_deg + box.north_deg) / 2), 4);

  AppendFile file(path);
  for (const Bytes* part : {&std::as_const(header), &directories.root, &metadata, &directories.leaves}) {
    file.append(*part);
  }
  for (const std::size_t i : contents) {
    const Bytes bytes = read(tiles[i].key);
    if (bytes.size() != tiles[i].size) {
      throw Error({.what = "a tile changed while it was exported",
                   .where = "tile " + to_text(tiles[i].key),
                   .expected = fmt::format("{} bytes", tiles[i].size),
                   .found = fmt::format("{} bytes", bytes.size()),
                   .fix = "nothing may change the tile set meanwhile"});
    }
    file.append(bytes);
    written();
  }
  return {tiles.size(), entries.size(), contents.size()};
}

// Reading.

PmtilesReader::PmtilesReader(InputFile file) : file_(std::move(file)) {
  std::array<std::uint8_t, kHeader_bytes> header{};
  if (!file_.read_at(0, header) || as_text(header).substr(0, kPmtilesMagic.size()) != kPmtilesMagic) {
    refuse("the header", "127 bytes that begin with \"PMTiles\" and the version 3", "something else");
  }
  const Section root = section(header, 8, "the root directory"), metadata = section(header, 24, "the metadata");
  leaves_ = section(header, 40, "the leaf directories");
  data_ = section(header, 56, "the tiles");
  internal_compression_ = header[97], tile_type_ = header[99];
  if (internal_compression_ != kNone && internal_compression_ != kGzip) {
    refuse("the header", "directories without compression (1) or by gzip (2)", std::to_string(internal_compression_));
  }
  if (header[98] != kNone) {
    refuse("the header", "images that are not compressed a second time (1)", std::to_string(header[98]));
  }
  if (tile_type_ != kPng && tile_type_ != kJpeg && tile_type_ != kWebp) {
    refuse("the header", "raster tiles: PNG (2), JPEG (3) or WebP (4)",
           tile_type_ == 1 ? "vector tiles (1)" : fmt::format("type {}", tile_type_));
  }
  if (metadata.size > 0) {
    const Bytes text = inflate(metadata, kMaxMetadata_bytes, "the metadata");
    metadata_ = as_text(text);
  }
  read_directory(root, 0);
  const auto first = tile_of_pmtiles_id(entries_.front().id);
  const auto last = tile_of_pmtiles_id(entries_.back().id + entries_.back().run - 1);
  if (!first || !last) refuse("a directory", fmt::format("zooms up to {}", kMaxZoom), "an id beyond");
  zooms_ = {first->z, last->z};
}

void PmtilesReader::refuse(const std::string& where, std::string expected, std::string found) const {
  throw Error({.what = "not a PMTiles file that can be read",
               .where = file_.path().string() + ", " + where,
               .expected = std::move(expected),
               .found = std::move(found),
               .fix = "get the file again, or check it with `pmtiles verify`"});
}

PmtilesReader::Section PmtilesReader::section(ByteView header, std::size_t field, const char* name) const {
  const Section part{le_at(header, field, 8), le_at(header, field + 8, 8)};
  if (part.at > file_.size() || part.size > file_.size() - part.at) {
    refuse(name, fmt::format("a part of the file's {} bytes", file_.size()),
           fmt::format("{} bytes from {} on", part.size, part.at));
  }
  return part;
}

Bytes PmtilesReader::inflate(const Section& part, std::uint64_t limit, const std::string& where) const {
  if (part.size > limit) refuse(where, fmt::format("at most {} bytes", limit), fmt::format("{} bytes", part.size));
  Bytes packed(part.size);
  if (!file_.read_at(part.at, packed)) refuse(where, "bytes of the file", "its end");
  if (internal_compression_ == kNone) return packed;
  z_stream stream{};
  if (inflateInit2(&stream, 15 + 16) != Z_OK) throw std::bad_alloc();
  const std::unique_ptr<z_stream, void (*)(z_stream*)> closing(&stream, [](z_stream* open) { inflateEnd(open); });
  stream.next_in = packed.data();
  stream.avail_in = static_cast<uInt>(packed.size());
  Bytes out;
  for (int result = Z_OK; result != Z_STREAM_END;) {
    const std::size_t had = out.size();
    if (had > limit) refuse(where, fmt::format("at most {} bytes when it is unpacked", limit), "more");
    out.resize(had + std::max<std::size_t>(std::size_t{1} << 16, std::min<std::size_t>(had, std::size_t{1} << 24)));
    stream.next_out = out.data() + had;
    stream.avail_out = static_cast<uInt>(out.size() - had);
    result = ::inflate(&stream, Z_NO_FLUSH);
    out.resize(out.size() - stream.avail_out);
    if (result != Z_OK && result != Z_STREAM_END) {
      refuse(where, "gzip", stream.msg != nullptr ? stream.msg : "a truncated stream");
    }
  }
  return out;
}

void PmtilesReader::read_directory(const Section& part, int depth) {
  constexpr const char* kWhere = "a directory";
  if (depth >= kMaxDepth) refuse(kWhere, fmt::format("directories nested at most {} deep", kMaxDepth), "deeper ones");
  const Bytes bytes = inflate(part, (kMaxEntries - entries_.size()) * kEntry_bytes + 1024, kWhere);
  Numbers numbers(bytes);
  constexpr std::uint64_t kAny = ~std::uint64_t{0}, kAny32 = ~std::uint32_t{0};
  const auto number = [&](std::uint64_t most) {
    const auto value = numbers.next(most);
    if (!value) refuse(kWhere, "numbers of variable length", "its end, or a larger number");
    return *value;
  };
  const std::uint64_t count = number(kAny);
  if (count == 0) refuse(kWhere, "entries", "none");
  if (count > numbers.left() || count > kMaxEntries - entries_.size()) {
    refuse(kWhere, fmt::format("at most {} entries in all directories", kMaxEntries), fmt::format("{} more", count));
  }
  std::vector<Entry> entries(count);
  std::uint64_t id = 0;
  for (Entry& entry : entries) {
    const std::uint64_t step = number(first_id(kMaxZoom + 1));
    if (step == 0 && &entry != entries.data()) refuse(kWhere, "ids that grow", "one twice");
    entry.id = id += step;
  }
  for (Entry& entry : entries) entry.run = static_cast<std::uint32_t>(number(kAny32));
  for (Entry& entry : entries) entry.size = static_cast<std::uint32_t>(number(kAny32));
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const std::uint64_t place = number(kAny);
    if (place == 0 && i == 0) refuse(kWhere, "a place for its first entry", "none");
    entries[i].at = place == 0 ? entries[i - 1].at + entries[i - 1].size : place - 1;
  }
  if (numbers.left() > 0) refuse(kWhere, "nothing behind its entries", fmt::format("{} bytes", numbers.left()));
  for (const Entry& entry : entries) {
    const Section& whole = entry.run == 0 ? leaves_ : data_;
    if (entry.at > whole.size || entry.size > whole.size - entry.at || entry.size == 0) {
      refuse(fmt::format("{}, id {}", kWhere, entry.id), fmt::format("bytes within the {} of its section", whole.size),
             fmt::format("{} from {} on", entry.size, entry.at));
    }
    if (entry.run == 0) {
      read_directory({whole.at + entry.at, entry.size}, depth + 1);
      continue;
    }
    if (!entries_.empty() && entry.id < entries_.back().id + entries_.back().run) {
      refuse(kWhere, "ids that grow", fmt::format("{} after {}", entry.id, entries_.back().id));
    }
    if (entries_.size() >= kMaxEntries) refuse(kWhere, fmt::format("at most {} entries", kMaxEntries), "more");
    entries_.push_back({entry.id, data_.at + entry.at, entry.size, entry.run});
  }
}

const PmtilesReader::Entry* PmtilesReader::find(const TileKey& key) const {
  if (!key.valid()) return nullptr;
  const std::uint64_t id = pmtiles_id(key);
  auto after = std::upper_bound(entries_.begin(), entries_.end(), id,
                                [](std::uint64_t wanted, const Entry& entry) { return wanted < entry.id; });
  if (after == entries_.begin()) return nullptr;
  --after;
  return id - after->id < after->run ? &*after : nullptr;
}

std::optional<std::uint32_t> PmtilesReader::stored_size(const TileKey& key) const {
  const Entry* entry = find(key);
  return entry == nullptr ? std::nullopt : std::optional(entry->size);
}

std::optional<Bytes> PmtilesReader::read(const TileKey& key) const {
  const Entry* entry = find(key);
  if (entry == nullptr) return std::nullopt;
  const std::string where = "tile " + to_text(key);
  if (entry->size > kMaxTile_bytes) {
    refuse(where, fmt::format("at most {} bytes", kMaxTile_bytes), fmt::format("{} bytes", entry->size));
  }
  Bytes bytes(entry->size);
  if (!file_.read_at(entry->at, bytes)) refuse(where, "bytes of the file", "its end");
  return bytes;
}

std::vector<TileKey> PmtilesReader::keys() const {
  std::vector<TileKey> keys;
  for (const Entry& entry : entries_) {
    if (entry.run > kMaxEntries - keys.size()) {
      refuse("the directories", fmt::format("at most {} tiles", kMaxEntries), "more");
    }
    for (std::uint32_t i = 0; i < entry.run; ++i) {
      if (const auto key = tile_of_pmtiles_id(entry.id + i)) keys.push_back(*key);
    }
  }
  std::sort(keys.begin(), keys.end());
  return keys;
}

std::string_view PmtilesReader::tile_type() const {
  return tile_type_ == kJpeg ? "jpg" : tile_type_ == kPng ? "png" : "webp";
}

}  // namespace nadir
