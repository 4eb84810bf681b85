#include "object_storage/pinned_object.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <condition_variable>
#include <list>
#include <map>
#include <set>
#include <utility>

#include "base/error.hpp"
#include "base/printable.hpp"

namespace nadir {
namespace {

constexpr std::uint64_t kRequest_bytes = std::uint64_t{8} << 20;  // at once, when more is wanted than a block

std::uint64_t block_count(std::uint64_t bytes, std::uint64_t block_bytes) {
  return (bytes + block_bytes - 1) / block_bytes;
}

}  // namespace

bool is_block_size(std::uint64_t block_bytes) {
  return block_bytes >= 4096 && block_bytes <= (std::uint64_t{16} << 20) && (block_bytes & (block_bytes - 1)) == 0;
}

std::string blocks_text(const ObjectPin& pin) {
  Bytes all;
  all.reserve(pin.blocks.size() * sizeof(Sha256::bytes));
  for (const Sha256& block : pin.blocks) all.insert(all.end(), block.bytes.begin(), block.bytes.end());
  return to_base64(all);
}

std::optional<std::vector<Sha256>> parse_blocks(std::string_view text, std::uint64_t bytes, std::uint64_t block_bytes) {
  const std::optional<Bytes> all = from_base64(text);
  constexpr std::size_t kDigest_bytes = sizeof(Sha256::bytes);
  if (!all || bytes == 0 || !is_block_size(block_bytes) || all->size() % kDigest_bytes != 0 ||
      all->size() / kDigest_bytes != block_count(bytes, block_bytes)) {
    return std::nullopt;
  }
  std::vector<Sha256> blocks(all->size() / kDigest_bytes);
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    std::copy_n(all->begin() + static_cast<std::ptrdiff_t>(i * kDigest_bytes), kDigest_bytes, blocks[i].bytes.begin());
  }
  return blocks;
}

ObjectPin pin_object(ObjectClient& client, const ObjectAddress& object, Progress& progress) {
  ObjectPin pin{object, 0, {}, kPinBlock_bytes, {}};
  Sha256Stream whole;
  std::string etag;
  std::uint64_t at = 0;
  do {
    const ObjectPart part = client.read(object, at, kRequest_bytes);
    if (part.object_bytes == 0) throw Error({.what = "an object is empty", .where = object.url});
    if (at == 0) {
      pin.bytes = part.object_bytes;
      etag = part.etag;
      progress.begin("pinning " + object.url, block_count(pin.bytes, kRequest_bytes), "requests");
    } else if (part.object_bytes != pin.bytes || part.etag != etag) {
      throw Error({.what = "an object changed while it was pinned",
                   .where = object.url,
                   .expected = fmt::format("{} bytes, ETag {}", pin.bytes, printable(etag)),
                   .found = fmt::format("{} bytes, ETag {}", part.object_bytes, printable(part.etag)),
                   .fix = "pin it again when nobody writes to it"});
    }
    whole.update(part.bytes);
    for (std::size_t block = 0; block < part.bytes.size(); block += kPinBlock_bytes) {
      pin.blocks.push_back(sha256(
          ByteView(part.bytes).subspan(block, std::min<std::size_t>(kPinBlock_bytes, part.bytes.size() - block))));
    }
    at += part.bytes.size();
    progress.advance();
  } while (at < pin.bytes);
  progress.end();
  pin.sha256 = whole.finish();
  return pin;
}

// Blocks by object and number; the most recently used first.
struct BlockCache::State {
  using Key = std::pair<const PinnedObject*, std::uint64_t>;
  using Block = std::shared_ptr<const Bytes>;
  struct Entry {
    Block block;
    std::list<Key>::iterator place;
  };

  Block find(const Key& key) {
    const auto found = blocks.find(key);
    if (found == blocks.end()) return nullptr;
    order.splice(order.begin(), order, found->second.place);
    return found->second.block;
  }
  void add(const Key& key, Block block) {
    held_bytes += block->size();
    order.push_front(key);
    blocks[key] = {std::move(block), order.begin()};
    while (held_bytes > most_bytes && order.size() > 1) {
      const auto last = blocks.find(order.back());
      held_bytes -= last->second.block->size();
      blocks.erase(last);
      order.pop_back();
    }
  }

  std::uint64_t most_bytes = 0, held_bytes = 0;
  std::mutex mutex;
  std::condition_variable fetched;
  std::list<Key> order;
  std::map<Key, Entry> blocks;
  std::set<Key> under_way;  // some thread is fetching these
};

BlockCache::BlockCache(std::uint64_t most_bytes) : state_(std::make_unique<State>()) {
  state_->most_bytes = most_bytes;
}
BlockCache::~BlockCache() = default;

PinnedObject::PinnedObject(ObjectPin pin, std::shared_ptr<ObjectClient> client, std::shared_ptr<BlockCache> cache)
    : pin_(std::move(pin)), client_(std::move(client)), cache_(std::move(cache)) {}

void PinnedObject::require_sound() const {
  const std::lock_guard lock(mutex_);
  if (failure_) std::rethrow_exception(failure_);
}

template <typename Work>
void PinnedObject::remembering_failure(const Work& work) {
  require_sound();
  try {
    work();
  } catch (...) {
    const std::lock_guard lock(mutex_);
    if (!failure_) failure_ = std::current_exception();
    throw;
  }
}

void PinnedObject::read_at(std::uint64_t at, std::span<std::uint8_t> target) {
  remembering_failure([&] {
    const std::uint64_t end = at + target.size();
    for (std::uint64_t next = at; next < end;) {
      const std::uint64_t number = next / pin_.block_bytes, inside = next % pin_.block_bytes;
      const auto bytes = block(number, (end - 1) / pin_.block_bytes);
      const std::uint64_t count = std::min<std::uint64_t>(bytes->size() - inside, end - next);
      std::copy_n(bytes->begin() + static_cast<std::ptrdiff_t>(inside), count,
                  target.begin() + static_cast<std::ptrdiff_t>(next - at));
      next += count;
    }
  });
}

void PinnedObject::prefetch(std::uint64_t at, std::uint64_t size) {
  if (size == 0) return;
  remembering_failure([&] {
    const std::uint64_t last = (at + size - 1) / pin_.block_bytes;
    for (std::uint64_t number = at / pin_.block_bytes; number <= last; ++number) block(number, last);
  });
}

// last: those up to this one will be wanted as well.
std::shared_ptr<const Bytes> PinnedObject::block(std::uint64_t number, std::uint64_t last) {
  BlockCache::State& cache = *cache_->state_;
  for (;;) {
    std::uint64_t end = number;  // of what this thread fetches
    {
      std::unique_lock lock(cache.mutex);
      cache.fetched.wait(lock, [&] { return !cache.under_way.contains({this, number}); });
      if (auto block = cache.find({this, number})) return block;
      const std::uint64_t most = std::min(last, number + kRequest_bytes / pin_.block_bytes - 1);
      const auto missing = [&](std::uint64_t i) {
        return !cache.under_way.contains({this, i}) && !cache.blocks.contains({this, i});
      };
      while (end < most && missing(end + 1)) ++end;
      for (std::uint64_t i = number; i <= end; ++i) cache.under_way.insert({this, i});
    }
    fetch(number, end);
  }
}

void PinnedObject::fetch(std::uint64_t first, std::uint64_t last) {
  BlockCache::State& cache = *cache_->state_;
  std::vector<BlockCache::State::Block> blocks;
  const auto hand_over = [&] {  // whatever came of it: others wait
    const std::lock_guard lock(cache.mutex);
    for (std::uint64_t i = first; i <= last; ++i) cache.under_way.erase({this, i});
    for (std::size_t i = blocks.size(); i-- > 0;) cache.add({this, first + i}, blocks[i]);
    cache.fetched.notify_all();
  };
  try {
    const std::uint64_t begin = first * pin_.block_bytes;
    const std::uint64_t size = std::min((last + 1) * pin_.block_bytes, pin_.bytes) - begin;
    const ObjectPart part = client_->read(pin_.address, begin, size);
    if (part.object_bytes != pin_.bytes) {
      refuse_change("", fmt::format("{} bytes", pin_.bytes), fmt::format("{} bytes", part.object_bytes));
    }
    for (std::uint64_t i = first; i <= last; ++i) {
      const std::uint64_t from = (i - first) * pin_.block_bytes;
      const ByteView bytes = ByteView(part.bytes).subspan(from, std::min(pin_.block_bytes, size - from));
      const Sha256 digest = sha256(bytes);
      if (digest != pin_.blocks[i]) {
        refuse_change(fmt::format(" (bytes {} to {})", begin + from, begin + from + bytes.size() - 1),
                      "sha256 " + pin_.blocks[i].hex(), "sha256 " + digest.hex());
      }
      blocks.push_back(std::make_shared<const Bytes>(bytes.begin(), bytes.end()));
    }
  } catch (...) {
    blocks.clear();
    hand_over();
    throw;
  }
  hand_over();
}

void PinnedObject::refuse_change(std::string where, std::string expected, std::string found) const {
  throw Error({.what = "an object has changed since it was pinned",
               .where = pin_.address.url + where,
               .expected = std::move(expected),
               .found = std::move(found),
               .fix = "restore it; or pin it again, if the new one is wanted: nadir cache pin"});
}

}  // namespace nadir
