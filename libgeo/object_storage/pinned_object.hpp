// An object that a result was promised from: its bytes are the pinned ones, or they are not read.
//
// A pin holds the object's size, its SHA-256, and the SHA-256 of each of its blocks of 256 KiB. It is made by reading
// the object once. Whoever holds it can read any part of the object later, from a server that is not trusted, and knows
// of every byte that it is the pinned one, after reading only the blocks that the part touches: a list of digests, as
// BitTorrent and dm-verity have it.
//
// Why not the server's ETag: it is whatever the server says. S3's is an MD5 for some uploads, the MD5 of the parts'
// MD5s for others, neither with some encryptions; uploading the same bytes again may change it, and a server that lies
// keeps it. Asking for it costs a request an object, and the answer is old when the next byte is read. Here nothing is
// asked: an object that has changed since it was pinned, before the build or during it, shows in the first block that
// differs.
#pragma once

#include <cstdint>
#include <exception>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "base/bytes.hpp"
#include "base/digest.hpp"
#include "base/progress.hpp"
#include "object_storage/object_client.hpp"

namespace nadir {

// A row of tiles of a COG that is 16 000 pixels wide has about 1 MB: with blocks of that size eight shards of such an
// image read 3.6 times the object together, with blocks of 256 KiB 2.0 times (bench scale, 2026-11-26).
inline constexpr std::uint64_t kPinBlock_bytes = std::uint64_t{256} << 10;

struct ObjectPin {
  ObjectAddress address;
  std::uint64_t bytes = 0;
  Sha256 sha256;
  std::uint64_t block_bytes = kPinBlock_bytes;
  std::vector<Sha256> blocks;  // the last one may be shorter

  bool operator==(const ObjectPin&) const = default;
};

// The digests of the blocks one after the other, in base64. parse_blocks(): nothing unless they are those of an object
// of this size.
std::string blocks_text(const ObjectPin& pin);
std::optional<std::vector<Sha256>> parse_blocks(std::string_view text, std::uint64_t bytes, std::uint64_t block_bytes);
bool is_block_size(std::uint64_t block_bytes);  // one that readers accept: a power of two, 4 KiB to 16 MiB

// Reads all of it. Throws Error when it cannot be read, or changes meanwhile.
ObjectPin pin_object(ObjectClient& client, const ObjectAddress& object, Progress& progress);

// The blocks that were read last, of all objects together. Safe from several threads; a block that two of them want is
// fetched once.
class BlockCache {
 public:
  explicit BlockCache(std::uint64_t most_bytes);
  ~BlockCache();

 private:
  friend class PinnedObject;
  struct State;
  std::unique_ptr<State> state_;
};

class PinnedObject {
 public:
  PinnedObject(ObjectPin pin, std::shared_ptr<ObjectClient> client, std::shared_ptr<BlockCache> cache);

  const ObjectPin& pin() const { return pin_; }

  // Fills the target. [at, at + size) must lie within the object. Throws Error when a block cannot be read or is not
  // the pinned one; then every later call throws the same, so that no reader can go on as if a part were empty.
  void read_at(std::uint64_t at, std::span<std::uint8_t> target);

  // The bytes will be read piece by piece: what is missing of them is fetched in as few requests as possible. Throws as
  // read_at() does.
  void prefetch(std::uint64_t at, std::uint64_t size);

  // Throws what read_at() threw, if it did: for callers that libraries swallowed it from.
  void require_sound() const;

 private:
  template <typename Work>
  void remembering_failure(const Work& work);
  std::shared_ptr<const Bytes> block(std::uint64_t number, std::uint64_t last);
  void fetch(std::uint64_t first, std::uint64_t last);
  [[noreturn]] void refuse_change(std::string where, std::string expected, std::string found) const;

  ObjectPin pin_;
  std::shared_ptr<ObjectClient> client_;
  std::shared_ptr<BlockCache> cache_;
  mutable std::mutex mutex_;
  std::exception_ptr failure_;
};

}  // namespace nadir
