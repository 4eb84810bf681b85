// Many small tiles as one body that is sent in parts and resumed at any byte:
//
//   "NADIRPK1" | count: u32 | count times (sha256: 32 bytes, size: u32) | the tiles' bytes in this order
//
// Numbers are big-endian. Nothing is compressed: tiles are compressed images, and what is not decompressed cannot be a
// bomb. A pack is named by the SHA-256 of all its bytes.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "base/digest.hpp"

namespace nadir {

inline constexpr std::string_view kPackMagic = "NADIRPK1";
inline constexpr std::uint64_t kMaxPackSize = std::uint64_t{8} << 20;   // bytes
inline constexpr std::uint64_t kGoodPackSize = std::uint64_t{4} << 20;  // below it packs are worth filling up
inline constexpr std::uint32_t kMaxPackTiles = 2000;
inline constexpr std::uint64_t kMaxPackTileSize = std::uint64_t{1} << 20;
inline constexpr std::uint64_t kPackHeadSize = 12;   // magic and count
inline constexpr std::uint64_t kPackEntrySize = 36;  // digest and size

struct PackEntry {
  Sha256 sha256;
  std::uint32_t size = 0;  // bytes, 1 to kMaxPackTileSize

  bool operator==(const PackEntry&) const = default;
};

// The size of the pack that holds these. Throws Error when no pack may: none or too many, one twice, a size that no
// tile has, all together too large.
std::uint64_t pack_size(std::span<const PackEntry> entries);

// How many of the first entries fill one pack: until it is full, or the limit on tiles is met. The rest goes into
// further packs. At least 1 when there is any.
std::size_t entries_of_next_pack(std::span<const PackEntry> entries);

// Magic, count and entries: what stands before the tiles. Throws as pack_size().
Bytes pack_head(std::span<const PackEntry> entries);

// Reads a pack as it arrives, in chunks of any size, and trusts none of it: no size in the pack makes it allocate
// beyond its own limits, and a tile is passed on only when its bytes have the digest in the header. It needs memory for
// the list of tiles and for one tile.
class PackReader {
 public:
  // Is this tile announced, with this size? Asked for every entry before any tile is read.
  using Announced = std::function<bool(const PackEntry& entry)>;
  // Called with each tile, in the pack's order; the bytes live for the call alone.
  using Take = std::function<void(const PackEntry& entry, ByteView bytes)>;

  // length: of the whole pack, as stated by its sender.
  PackReader(std::uint64_t length, Announced announced, Take take);

  // Throws Error as soon as the bytes can be no such pack; the tiles passed on before are valid all the same.
  void feed(ByteView bytes);

  // Throws Error when something is missing.
  void finish() const;

  const std::vector<PackEntry>& entries() const { return entries_; }  // as far as read
  std::uint64_t bytes_read() const { return bytes_read_; }

 private:
  enum class Part { head, entries, tiles, done };
  bool gather(ByteView& bytes, std::uint64_t size);
  void read_head();
  void read_entries();
  void read_tile();

  std::uint64_t length_;
  Announced announced_;
  Take take_;
  Part part_ = Part::head;
  Bytes gathered_;
  std::uint32_t count_ = 0;
  std::vector<PackEntry> entries_;
  std::size_t next_tile_ = 0;
  std::uint64_t bytes_read_ = 0;
};

}  // namespace nadir
