#include "package/sidecar.hpp"

#include "base/error.hpp"

namespace nadir {
namespace {

void append_u32(Bytes& out, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) out.push_back(static_cast<std::uint8_t>(value >> shift));
}

void append_i64(Bytes& out, std::int64_t value) {
  const auto bits = static_cast<std::uint64_t>(value);
  append_u32(out, static_cast<std::uint32_t>(bits >> 32));
  append_u32(out, static_cast<std::uint32_t>(bits));
}

void append_sized(Bytes& out, ByteView bytes) {
  append_u32(out, static_cast<std::uint32_t>(bytes.size()));
  out.insert(out.end(), bytes.begin(), bytes.end());
}

}  // namespace

std::string_view name_of(TileTrust trust) {
  switch (trust) {
    case TileTrust::service: return "service";
    case TileTrust::candidate: return "candidate";
    case TileTrust::soft: return "soft";
  }
  return "soft";
}

std::optional<TileTrust> parse_tile_trust(std::string_view name) {
  for (const TileTrust trust : {TileTrust::service, TileTrust::candidate, TileTrust::soft}) {
    if (name == name_of(trust)) return trust;
  }
  return std::nullopt;
}

void SidecarDigest::add(const Sidecar& sidecar) {
  if (last_ && !(*last_ < sidecar.key)) {
    throw Error({.what = "sidecars are not in the order of their tiles", .where = to_text(sidecar.key)});
  }
  last_ = sidecar.key;
  row_.clear();
  row_.push_back(sidecar.key.z);
  append_u32(row_, sidecar.key.x);
  append_u32(row_, sidecar.key.y);
  row_.insert(row_.end(), sidecar.sha256.bytes.begin(), sidecar.sha256.bytes.end());
  append_i64(row_, sidecar.captured_at.unix_s);
  append_i64(row_, sidecar.gsd_mm);
  append_i64(row_, sidecar.ce90_mm);
  append_i64(row_, sidecar.valid_ppm);
  append_sized(row_, as_bytes(sidecar.source));
  append_sized(row_, as_bytes(name_of(sidecar.trust)));
  append_sized(row_, as_bytes(sidecar.sector));
  append_sized(row_, sidecar.mask);
  stream_.update(row_);
}

Sha256 SidecarDigest::finish() {
  last_.reset();
  return stream_.finish();
}

}  // namespace nadir
