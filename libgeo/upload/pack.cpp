#include "upload/pack.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <utility>

#include "base/error.hpp"

namespace nadir {
namespace {

[[noreturn]] void refuse_tiles(std::string expected, std::string found) {
  throw Error({.what = "these tiles cannot be packed", .expected = std::move(expected), .found = std::move(found)});
}

void append_u32(Bytes& bytes, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) bytes.push_back(static_cast<std::uint8_t>(value >> shift));
}

[[noreturn]] void refuse_pack(std::string expected, std::string found) {
  throw Error({.what = "cannot accept this pack", .expected = std::move(expected), .found = std::move(found)});
}

std::uint32_t u32_at(ByteView bytes, std::size_t at) {
  return std::uint32_t{bytes[at]} << 24 | std::uint32_t{bytes[at + 1]} << 16 | std::uint32_t{bytes[at + 2]} << 8 |
         std::uint32_t{bytes[at + 3]};
}

}  // namespace

std::uint64_t pack_size(std::span<const PackEntry> entries) {
  if (entries.empty() || entries.size() > kMaxPackTiles) {
    refuse_tiles(fmt::format("1 to {} tiles", kMaxPackTiles), fmt::format("{} tiles", entries.size()));
  }
  std::set<Sha256> seen;
  std::uint64_t size = kPackHeadSize + entries.size() * kPackEntrySize;
  for (const PackEntry& entry : entries) {
    if (entry.size == 0 || entry.size > kMaxPackTileSize) {
      refuse_tiles(fmt::format("tiles of 1 to {} bytes", kMaxPackTileSize),
                   fmt::format("{} of {} bytes", entry.sha256.hex(), entry.size));
    }
    if (!seen.insert(entry.sha256).second) refuse_tiles("each tile once", entry.sha256.hex() + " twice");
    size += entry.size;
  }
  if (size > kMaxPackSize) refuse_tiles(fmt::format("at most {} bytes", kMaxPackSize), fmt::format("{} bytes", size));
  return size;
}

std::size_t entries_of_next_pack(std::span<const PackEntry> entries) {
  std::uint64_t size = kPackHeadSize;
  std::size_t count = 0;
  while (count < entries.size() && count < kMaxPackTiles) {
    size += kPackEntrySize + entries[count].size;
    if (count > 0 && size > kMaxPackSize) break;
    ++count;
    if (size >= kGoodPackSize) break;
  }
  return count;
}

Bytes pack_head(std::span<const PackEntry> entries) {
  Bytes bytes;
  bytes.reserve(pack_size(entries));
  bytes.insert(bytes.end(), kPackMagic.begin(), kPackMagic.end());
  append_u32(bytes, static_cast<std::uint32_t>(entries.size()));
  for (const PackEntry& entry : entries) {
    bytes.insert(bytes.end(), entry.sha256.bytes.begin(), entry.sha256.bytes.end());
    append_u32(bytes, entry.size);
  }
  return bytes;
}

PackReader::PackReader(std::uint64_t length, Announced announced, Take take)
    : length_(length), announced_(std::move(announced)), take_(std::move(take)) {
  if (length_ > kMaxPackSize || length_ <= kPackHeadSize + kPackEntrySize) {
    refuse_pack(fmt::format("a pack of {} to {} bytes", kPackHeadSize + kPackEntrySize + 1, kMaxPackSize),
                fmt::format("{} bytes", length_));
  }
}

// Moves bytes over until `size` are gathered; true when they are.
bool PackReader::gather(ByteView& bytes, std::uint64_t size) {
  const std::size_t take = std::min<std::size_t>(size - gathered_.size(), bytes.size());
  gathered_.insert(gathered_.end(), bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(take));
  bytes = bytes.subspan(take);
  bytes_read_ += take;
  return gathered_.size() == size;
}

void PackReader::feed(ByteView bytes) {
  while (!bytes.empty()) {
    switch (part_) {
      case Part::head:
        if (gather(bytes, kPackHeadSize)) read_head();
        break;
      case Part::entries:
        if (gather(bytes, count_ * kPackEntrySize)) read_entries();
        break;
      case Part::tiles:
        if (gather(bytes, entries_[next_tile_].size)) read_tile();
        break;
      case Part::done: refuse_pack(fmt::format("{} bytes", length_), "more bytes");
    }
  }
}

void PackReader::read_head() {
  if (as_text(ByteView(gathered_).first(kPackMagic.size())) != kPackMagic) {
    refuse_pack(fmt::format("\"{}\" at the beginning", kPackMagic), "different bytes");
  }
  count_ = u32_at(gathered_, kPackMagic.size());
  if (count_ == 0 || count_ > kMaxPackTiles) {
    refuse_pack(fmt::format("1 to {} tiles", kMaxPackTiles), fmt::format("{} tiles", count_));
  }
  // Each tile takes its entry and at least one byte.
  if (kPackHeadSize + count_ * (kPackEntrySize + 1) > length_) {
    refuse_pack(fmt::format("as many tiles as {} bytes can hold", length_), fmt::format("{} tiles", count_));
  }
  gathered_.clear();
  part_ = Part::entries;
}

void PackReader::read_entries() {
  std::vector<PackEntry> entries(count_);
  std::set<Sha256> seen;
  std::uint64_t size = kPackHeadSize + count_ * kPackEntrySize;
  for (std::size_t i = 0; i < count_; ++i) {
    const ByteView bytes = ByteView(gathered_).subspan(i * kPackEntrySize, kPackEntrySize);
    PackEntry& entry = entries[i];
    std::copy_n(bytes.begin(), entry.sha256.bytes.size(), entry.sha256.bytes.begin());
    entry.size = u32_at(bytes, entry.sha256.bytes.size());
    if (entry.size == 0 || entry.size > kMaxPackTileSize) {
      refuse_pack(fmt::format("tiles of 1 to {} bytes", kMaxPackTileSize),
                  fmt::format("{} of {} bytes", entry.sha256.hex(), entry.size));
    }
    if (!seen.insert(entry.sha256).second) refuse_pack("each tile once", entry.sha256.hex() + " twice");
    if (!announced_(entry)) {
      refuse_pack("only tiles that were announced, with the size announced",
                  fmt::format("{} of {} bytes", entry.sha256.hex(), entry.size));
    }
    size += entry.size;
  }
  if (size != length_) refuse_pack(fmt::format("tiles that fill {} bytes", length_), fmt::format("{} bytes", size));
  entries_ = std::move(entries);
  gathered_.clear();
  part_ = Part::tiles;
}

void PackReader::read_tile() {
  const PackEntry& entry = entries_[next_tile_];
  if (sha256(gathered_) != entry.sha256) {
    refuse_pack(fmt::format("the bytes of tile {}", entry.sha256.hex()), "different bytes at its place");
  }
  take_(entry, gathered_);
  gathered_.clear();
  if (++next_tile_ == entries_.size()) part_ = Part::done;
}

void PackReader::finish() const {
  if (part_ != Part::done) refuse_pack(fmt::format("{} bytes", length_), fmt::format("{} bytes", bytes_read_));
}

}  // namespace nadir
