#include "candidates/pack_intake.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "base/error.hpp"
#include "base/files.hpp"
#include "upload/pack.hpp"

namespace nadir {
namespace {

using SizeByDigest = std::map<Sha256, std::uint64_t>;

// Throws Error for anything but a pack of announced tiles.
std::vector<CandidateCatalogue::PackedTile> tiles_in(ByteView bytes, const IncomingPack& pack,
                                                     const SizeByDigest& announced) {
  if (sha256(bytes) != pack.sha256) {
    throw Error({.what = "cannot accept this pack",
                 .expected = "SHA-256 " + pack.sha256.hex(),
                 .found = "SHA-256 " + sha256(bytes).hex()});
  }
  PackReader reader(
      pack.length,
      [&announced](const PackEntry& entry) {
        const auto found = announced.find(entry.sha256);
        return found != announced.end() && found->second == entry.size;
      },
      [](const PackEntry&, ByteView) {});
  reader.feed(bytes);
  reader.finish();
  std::vector<CandidateCatalogue::PackedTile> packed;
  std::uint64_t start = kPackHeadSize + reader.entries().size() * kPackEntrySize;
  for (const PackEntry& entry : reader.entries()) {
    packed.push_back({.sha256 = entry.sha256, .start = start, .bytes = entry.size});
    start += entry.size;
  }
  return packed;
}

}  // namespace

// Claims a pack for one call; false for the others.
class PackIntake::Claim {
 public:
  Claim(PackIntake& intake, const std::string& upload, const Sha256& pack) : intake_(intake), key_(upload, pack) {
    const std::lock_guard lock(intake_.mutex_);
    got_ = intake_.claimed_.insert(key_).second;
  }
  ~Claim() {
    if (!got_) return;
    const std::lock_guard lock(intake_.mutex_);
    intake_.claimed_.erase(key_);
  }
  Claim(const Claim&) = delete;
  Claim& operator=(const Claim&) = delete;

  explicit operator bool() const { return got_; }

 private:
  PackIntake& intake_;
  std::pair<std::string, Sha256> key_;
  bool got_ = false;
};

PackIntake::PackIntake(std::filesystem::path folder, PackStore& kept, CatalogueThread& catalogue, AuditLog& audit,
                       const Clock& clock, const PackLimits& limits)
    : incoming_(std::move(folder)), kept_(kept), catalogue_(catalogue), audit_(audit), clock_(clock), limits_(limits) {}

std::optional<Denial> PackIntake::no_room(std::uint64_t bytes) const {
  const std::uint64_t needed = std::max<std::uint64_t>(1, limits_.keep_free_bytes + bytes);
  if (kept_.free_bytes() >= needed) return std::nullopt;
  return disk_full();
}

// Checks a whole pack and keeps it; or says why it is invalid and removes it.
std::optional<Denial> PackIntake::accept(const UploadRow& upload, const IncomingPack& pack) {
  const std::vector<TileRow> tiles = catalogue_.call([&upload](CandidateCatalogue& catalogue) {
    return catalogue.tiles_of(upload.id, CandidateCatalogue::Detail::verdicts);
  });
  SizeByDigest announced;  // size by digest, of those that were not refused
  for (const TileRow& tile : tiles) {
    if (tile.verdict != Verdict::rejected) announced[tile.sha256] = tile.size;
  }
  std::vector<CandidateCatalogue::PackedTile> packed;
  const Bytes bytes = read_file(pack.path, kMaxPackSize);
  try {
    packed = tiles_in(bytes, pack, announced);
  } catch (const Error& error) {
    audit_.record({.act = "pack.take",
                   .result = "refused",
                   .client = upload.client,
                   .subject = fmt::format("{} {} {}", upload.airframe, upload.flight, upload.batch),
                   .detail = error.what()});
    incoming_.remove(pack);
    return Denial{.kind = Denial::Kind::pack_invalid, .detail = error.what()};
  }
  catalogue_.call([&](CandidateCatalogue& catalogue) {
    catalogue.add_pack(upload.id, pack.sha256, pack.length, packed, [&] { kept_.adopt(pack.path, pack.sha256); });
  });
  incoming_.remove(pack);
  return std::nullopt;
}

Answer<PackOffset> PackIntake::offset(const UploadRow& upload, const Sha256& sha256) {
  const auto size =
      catalogue_.call([&](CandidateCatalogue& catalogue) { return catalogue.pack_size(upload.id, sha256); });
  if (size) return PackOffset{.offset = *size, .length = *size};
  const Claim busy(*this, upload.name, sha256);
  const auto pack = incoming_.find(upload.name, sha256);
  if (pack && !pack->whole()) return PackOffset{.offset = pack->offset};
  if (pack && busy) {  // whole, but its last call was cut off before it was taken in
    if (auto denial = accept(upload, *pack)) return *denial;
    return PackOffset{.offset = pack->length, .length = pack->length};
  }
  if (pack) return PackOffset{.offset = pack->offset};
  return Denial{.kind = Denial::Kind::pack_unknown, .detail = "no part of this pack has been received"};
}

// Removes the pack that has rested for longest; its sender would begin again. True: there is room.
bool PackIntake::evict_abandoned(const std::string& upload) {
  std::optional<IncomingPack> oldest;
  for (IncomingPack& pack : incoming_.of(upload)) {
    if (!pack.whole() && (!oldest || pack.grown_s < oldest->grown_s)) oldest = std::move(pack);
  }
  if (!oldest || clock_.now().unix_s - oldest->grown_s < limits_.pack_rest_s) return false;
  const Claim busy(*this, upload, oldest->sha256);
  if (busy) incoming_.remove(*oldest);
  return static_cast<bool>(busy);
}

Answer<PackOffset> PackIntake::append(const UploadRow& upload, const Sha256& sha256, const PartHeader& header,
                                      ByteView part) {
  if (nadir::sha256(part) != header.digest) {
    return Denial{
        .kind = Denial::Kind::digest_mismatch,
        .detail = "the part's SHA-256 is not that of its Content-Digest; the part was discarded, send it again"};
  }
  if (part.empty()) return Denial{.kind = Denial::Kind::malformed, .detail = "a part must have at least one byte"};
  const auto size =
      catalogue_.call([&](CandidateCatalogue& catalogue) { return catalogue.pack_size(upload.id, sha256); });
  const auto elsewhere = [](std::uint64_t offset) {
    return Denial{.kind = Denial::Kind::offset_mismatch,
                  .detail = fmt::format("the pack continues at byte {}", offset),
                  .offset = offset};
  };
  if (size) return elsewhere(*size);
  const Claim busy(*this, upload.name, sha256);
  auto pack = incoming_.find(upload.name, sha256);
  if (!busy) {
    return Denial{.kind = Denial::Kind::pack_busy,
                  .detail = "another call is writing this pack; ask again later",
                  .offset = pack ? pack->offset : 0};
  }
  if (!pack) {
    if (header.offset != 0) return elsewhere(0);
    if (!header.length)
      return Denial{.kind = Denial::Kind::malformed, .detail = "send Upload-Length with a pack's first part"};
    if (*header.length > kMaxPackSize) {
      return Denial{.kind = Denial::Kind::too_large,
                    .detail = fmt::format("a pack may have at most {} bytes", kMaxPackSize)};
    }
    if (upload.state != UploadState::open) {
      return Denial{.kind = Denial::Kind::pack_invalid, .detail = "the upload is complete; nothing is missing"};
    }
    if (incoming_.of(upload.name).size() >= limits_.packs_at_once && !evict_abandoned(upload.name)) {
      return Denial{.kind = Denial::Kind::too_many,
                    .detail = fmt::format("send at most {} packs at a time", limits_.packs_at_once)};
    }
    pack = incoming_.begin(upload.name, sha256, *header.length);
  }
  if (header.length && *header.length != pack->length) {
    return Denial{.kind = Denial::Kind::pack_invalid,
                  .detail = fmt::format("the pack was begun with Upload-Length {}", pack->length)};
  }
  if (header.offset != pack->offset) return elsewhere(pack->offset);
  if (part.size() > pack->length - pack->offset) {
    return Denial{.kind = Denial::Kind::too_large, .detail = "the part ends beyond the pack's end"};
  }
  if (auto full = no_room(pack->length)) return *full;
  incoming_.append(*pack, part, clock_.now());
  if (pack->whole()) {
    if (auto denial = accept(upload, *pack)) return *denial;
    return PackOffset{.offset = pack->length, .length = pack->length};
  }
  return PackOffset{.offset = pack->offset};
}

void PackIntake::accept_whole(const UploadRow& upload) {
  for (const IncomingPack& pack : incoming_.of(upload.name)) {
    if (pack.whole()) offset(upload, pack.sha256);
  }
}

void PackIntake::recover(const std::vector<UploadRow>& uploads) {
  std::set<std::string> names;
  for (const UploadRow& upload : uploads) {
    names.insert(upload.name);
    for (const IncomingPack& pack : incoming_.of(upload.name)) {
      if (pack.whole()) accept(upload, pack);
    }
  }
  for (const std::string& name : incoming_.uploads()) {
    if (!names.contains(name)) incoming_.remove_all_of(name);
  }
  const std::set<Sha256> known = catalogue_.call([](CandidateCatalogue& catalogue) { return catalogue.packs(); });
  for (const Sha256& pack : kept_.packs()) {
    if (!known.contains(pack)) kept_.remove(pack);
  }
}

}  // namespace nadir
