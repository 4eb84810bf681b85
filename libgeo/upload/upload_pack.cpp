// Sending one pack: in parts, from wherever the service has got to.
#include <algorithm>

#include "upload/uploader.hpp"

namespace nadir {

void Uploader::send(const OpenBatch& batch, const OpenPack& pack) {
  std::uint64_t offset = 0;
  if (pack.begun && !begin_at(batch, pack, offset)) return;
  const Bytes bytes = transfer_.pack_bytes(pack);
  transfer_.pack_begins(pack, around_.pace.now_ms());
  while (offset < pack.size) {
    check();
    const std::uint64_t most = std::min(part_bytes_, batch.part_max);
    const ByteView part = ByteView(bytes).subspan(offset).first(std::min(most, pack.size - offset));
    outcome_.body_bytes += part.size();
    auto answer = service_.send_part(batch.upload, pack.sha256, pack.size, offset, part);
    if (const auto* reached = std::get_if<std::uint64_t>(&answer); reached != nullptr && *reached <= offset) {
      answer = Trouble{Trouble::Kind::nonsense, "an offset that has not come forward"};
    }
    if (const auto* trouble = std::get_if<Trouble>(&answer)) {
      if (part_failed(batch, *trouble, offset)) continue;
      transfer_.pack_waits(pack, around_.pace.now_ms());
      return handle(batch, *trouble, options_.most_refusals);
    }
    offset = std::get<std::uint64_t>(answer);
    part_bytes_ = std::min(part_bytes_ * 2, options_.part_bytes);
    came_forward(batch);
  }
  around_.progress.advance(static_cast<std::uint64_t>(transfer_.pack_sent(pack, around_.pace.now_ms())));
  // What has arrived is there, even when the service forgets the upload.
  transfer_.forgive(batch, {name_of(Trouble::Kind::refused), name_of(Trouble::Kind::forgotten)});
  came_forward(batch);
}

// Asks the service how far the pack has come. False when it does not say, and the batch has to wait.
bool Uploader::begin_at(const OpenBatch& batch, const OpenPack& pack, std::uint64_t& offset) {
  const auto answer = service_.offset(batch.upload, pack.sha256);
  if (const auto* trouble = std::get_if<Trouble>(&answer)) {
    handle(batch, *trouble);
    return false;
  }
  offset = std::get<std::uint64_t>(answer);
  if (offset <= pack.size) return true;
  handle(batch, {Trouble::Kind::nonsense, "an offset behind the end of the pack"});
  return false;
}

// True when the next part may follow at once: at another offset, smaller, or the same again.
bool Uploader::part_failed(const OpenBatch& batch, const Trouble& trouble, std::uint64_t& offset) {
  constexpr int kMostConflicts = 20;
  constexpr std::uint64_t kLeastPart = 4096;  // part_max is at least that
  switch (trouble.kind) {
    case Trouble::Kind::conflict:
      if (!trouble.offset || too_often(batch, trouble.kind, kMostConflicts)) return false;
      ++outcome_.retries;
      offset = *trouble.offset;
      return true;
    case Trouble::Kind::mangled:
      if (too_often(batch, trouble.kind, options_.most_refusals)) return false;
      ++outcome_.retries;
      return true;
    case Trouble::Kind::too_large:
      if (part_bytes_ <= kLeastPart) return false;
      part_bytes_ = std::max(part_bytes_ / 2, kLeastPart);
      return true;
    case Trouble::Kind::later:  // perhaps a line that breaks: then less is lost the next time
      part_bytes_ = std::max(part_bytes_ / 2, options_.least_part_bytes);
      return false;
    default: return false;
  }
}

}  // namespace nadir
