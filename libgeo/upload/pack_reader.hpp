// Reads a pack as it comes, in pieces of any size, and trusts none of it: nothing is allocated because the pack says so
// beyond its own limits, and a tile is handed out only when its bytes have the digest that stands before it. The memory
// is that of the list of tiles and of one tile.
#pragma once

#include <functional>
#include <vector>

#include "upload/pack.hpp"

namespace nadir {

class PackReader {
 public:
  // Is this tile announced, with this size? Asked for every entry before any tile is read.
  using Announced = std::function<bool(const PackEntry& entry)>;
  // Called with each tile, in the pack's order; the bytes live for the call alone.
  using Take = std::function<void(const PackEntry& entry, ByteView bytes)>;

  // length: of the whole pack, as its sender says.
  PackReader(std::uint64_t length, Announced announced, Take take);

  // Throws Error as soon as the bytes can be no such pack; what take() was given before was right all the same.
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
