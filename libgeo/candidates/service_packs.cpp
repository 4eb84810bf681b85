// The candidate service's packs: parts come in, whole packs are checked and kept.
#include <fmt/format.h>

#include <map>

#include "base/error.hpp"
#include "base/files.hpp"
#include "candidates/candidate_service.hpp"
#include "upload/pack_reader.hpp"

namespace nadir {

using Kind = Denial::Kind;

// A pack that one call works on; the others are told so.
class BusyPack {
 public:
  BusyPack(CandidateService& service, const std::string& upload, const Sha256& pack)
      : service_(service), key_(upload, pack) {
    const std::lock_guard lock(service_.mutex_);
    got_ = service_.busy_.insert(key_).second;
  }
  ~BusyPack() {
    if (!got_) return;
    const std::lock_guard lock(service_.mutex_);
    service_.busy_.erase(key_);
  }
  BusyPack(const BusyPack&) = delete;
  BusyPack& operator=(const BusyPack&) = delete;

  explicit operator bool() const { return got_; }

 private:
  CandidateService& service_;
  std::pair<std::string, Sha256> key_;
  bool got_ = false;
};

namespace {

using SizeByDigest = std::map<Sha256, std::uint64_t>;

// Throws Error for anything but a pack of announced tiles.
std::vector<CandidateCatalogue::PackedTile> tiles_in(ByteView bytes, const IncomingPack& pack,
                                                     const SizeByDigest& announced) {
  if (sha256(bytes) != pack.sha256) {
    throw Error({.what = "cannot accept this pack", .expected = pack.sha256.hex(), .found = sha256(bytes).hex()});
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

// Checks a whole pack, keeps it and forgets what came of it; or why it is none, and then it is gone.
std::optional<Denial> CandidateService::take_in(const UploadRow& upload, const IncomingPack& pack) {
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
    incoming_.remove(pack);
    return Denial{.kind = Kind::pack_invalid, .detail = error.what()};
  }
  catalogue_.call([&](CandidateCatalogue& catalogue) {
    catalogue.add_pack(upload.id, pack.sha256, pack.length, packed, [&] { packs_.adopt(pack.path, pack.sha256); });
  });
  incoming_.remove(pack);
  return std::nullopt;
}

Answer<PackOffset> CandidateService::offset(const UploadClient& client, const std::string& name, const Sha256& sha256) {
  const auto found = find(client, name);
  if (const auto* denial = std::get_if<Denial>(&found)) return *denial;
  const auto& upload = std::get<UploadRow>(found);
  const auto size =
      catalogue_.call([&](CandidateCatalogue& catalogue) { return catalogue.pack_size(upload.id, sha256); });
  if (size) return PackOffset{.offset = *size, .length = *size};
  const BusyPack busy(*this, name, sha256);
  const auto pack = incoming_.find(name, sha256);
  if (pack && !pack->whole()) return PackOffset{.offset = pack->offset};
  if (pack && busy) {  // whole, but its last call was cut off before it was taken in
    if (auto denial = take_in(upload, *pack)) return *denial;
    return PackOffset{.offset = pack->length, .length = pack->length};
  }
  if (pack) return PackOffset{.offset = pack->offset};
  return Denial{.kind = Kind::pack_unknown, .detail = "nothing of this pack has come"};
}

// Whoever goes on with it after all begins again. True: there is room.
bool CandidateService::abandoned_gives_way(const std::string& upload) {
  std::optional<IncomingPack> oldest;
  for (IncomingPack& pack : incoming_.of(upload)) {
    if (!pack.whole() && (!oldest || pack.grown_s < oldest->grown_s)) oldest = std::move(pack);
  }
  if (!oldest || clock_.now().unix_s - oldest->grown_s < options_.pack_rest_s) return false;
  const BusyPack busy(*this, upload, oldest->sha256);
  if (busy) incoming_.remove(*oldest);
  return static_cast<bool>(busy);
}

Answer<PackOffset> CandidateService::append(const UploadClient& client, const std::string& name, const Sha256& sha256,
                                            const PartHeader& header, ByteView part) {
  const auto found = find(client, name);
  if (const auto* denial = std::get_if<Denial>(&found)) return *denial;
  const auto& upload = std::get<UploadRow>(found);
  if (nadir::sha256(part) != header.digest) {
    return Denial{.kind = Kind::digest_mismatch, .detail = "the part's SHA-256 is another one; nothing of it is kept"};
  }
  if (part.empty()) return Denial{.kind = Kind::malformed, .detail = "a part has at least one byte"};
  const auto size =
      catalogue_.call([&](CandidateCatalogue& catalogue) { return catalogue.pack_size(upload.id, sha256); });
  const auto elsewhere = [](std::uint64_t offset) {
    return Denial{
        .kind = Kind::offset_mismatch, .detail = fmt::format("the pack goes on at byte {}", offset), .offset = offset};
  };
  if (size) return elsewhere(*size);
  const BusyPack busy(*this, name, sha256);
  auto pack = incoming_.find(name, sha256);
  if (!busy) {
    return Denial{
        .kind = Kind::pack_busy, .detail = "another call writes this pack", .offset = pack ? pack->offset : 0};
  }
  if (!pack) {
    if (header.offset != 0) return elsewhere(0);
    if (!header.length) return Denial{.kind = Kind::malformed, .detail = "Upload-Length: with a pack's first part"};
    if (*header.length > kMaxPackSize) {
      return Denial{.kind = Kind::too_large, .detail = fmt::format("packs have at most {} bytes", kMaxPackSize)};
    }
    if (upload.state != UploadState::open) {
      return Denial{.kind = Kind::pack_invalid, .detail = "the upload is complete; nothing is missing"};
    }
    if (incoming_.of(name).size() >= options_.packs_at_once && !abandoned_gives_way(name)) {
      return Denial{.kind = Kind::too_many,
                    .detail = fmt::format("send at most {} packs at a time", options_.packs_at_once)};
    }
    pack = incoming_.begin(name, sha256, *header.length);
  }
  if (header.length && *header.length != pack->length) {
    return Denial{.kind = Kind::pack_invalid, .detail = fmt::format("Upload-Length was {} bytes before", pack->length)};
  }
  if (header.offset != pack->offset) return elsewhere(pack->offset);
  if (part.size() > pack->length - pack->offset) {
    return Denial{.kind = Kind::too_large, .detail = "the part goes beyond the pack's end"};
  }
  if (auto full = no_room(pack->length)) return *full;
  try {
    incoming_.append(*pack, part, clock_.now());
  } catch (const OutOfSpace&) {
    return Denial{.kind = Kind::storage_full, .detail = "the service's disk is full; its operator must make room"};
  }
  if (pack->whole()) {
    if (auto denial = take_in(upload, *pack)) return *denial;
    return PackOffset{.offset = pack->length, .length = pack->length};
  }
  return PackOffset{.offset = pack->offset};
}

void CandidateService::recover() {
  forget_expired();
  heed_revocations();
  const auto uploads = catalogue_.call([](CandidateCatalogue& catalogue) {
    std::vector<UploadRow> all = catalogue.uploads_in(UploadState::open);
    const std::vector<UploadRow> judging = catalogue.uploads_in(UploadState::judging);
    all.insert(all.end(), judging.begin(), judging.end());
    return all;
  });
  std::set<std::string> names;
  for (const UploadRow& upload : uploads) {
    names.insert(upload.name);
    for (const IncomingPack& pack : incoming_.of(upload.name)) {
      if (pack.whole()) take_in(upload, pack);
    }
  }
  for (const std::string& name : incoming_.uploads()) {
    if (!names.contains(name)) incoming_.remove_all_of(name);
  }
  const std::set<Sha256> known = catalogue_.call([](CandidateCatalogue& catalogue) { return catalogue.packs(); });
  for (const Sha256& pack : packs_.packs()) {
    if (!known.contains(pack)) packs_.remove(pack);
  }
}

void CandidateService::forget_expired() {
  const std::int64_t now_ms = clock_.now().unix_s * 1000;
  const auto gone = catalogue_.call([this, now_ms](CandidateCatalogue& catalogue) {
    std::vector<std::string> forgotten;
    for (const UploadRow& upload : catalogue.uploads_in(UploadState::open)) {
      if (upload.expires_ms > now_ms) continue;
      catalogue.remove_unused(catalogue.forget_upload(upload.id), [this](const Sha256& pack) { packs_.remove(pack); });
      forgotten.push_back(upload.name);
    }
    return forgotten;
  });
  for (const std::string& name : gone) incoming_.remove_all_of(name);
}

}  // namespace nadir
