#include "upload/batch.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/bytes.hpp"

namespace nadir {
namespace {

using nlohmann::json;

json json_from(const BatchTile& tile) {
  return {{"sidecar", json::parse(tile.sidecar_bytes)},
          {"keyid", tile.signature.keyid},
          {"sig", to_base64(tile.signature.signature)}};
}

}  // namespace

std::string uuid_from(std::array<std::uint8_t, 16> random) {
  random[6] = static_cast<std::uint8_t>((random[6] & 0x0F) | 0x40);
  random[8] = static_cast<std::uint8_t>((random[8] & 0x3F) | 0x80);
  std::string text;
  for (std::size_t i = 0; i < random.size(); ++i) {
    if (i == 4 || i == 6 || i == 8 || i == 10) text += '-';
    text += fmt::format("{:02x}", random[i]);
  }
  return text;
}

bool is_uuid(std::string_view text) {
  if (text.size() != 36) return false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    const bool dash = i == 8 || i == 13 || i == 18 || i == 23;
    if (dash ? c != '-' : !((c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'))) return false;
  }
  return true;
}

std::uint64_t batch_share(const BatchTile& tile) {
  // {"keyid":"…64…","sidecar":…,"sig":"…88…"}, and the comma.
  return tile.sidecar_bytes.size() + 64 + 88 + 40;
}

std::string SignedBatch::json() const {
  const nlohmann::json envelope = nlohmann::json::parse(envelope_json({"", document.signatures}));
  return fmt::format(R"({{"signatures":{},"signed":{}}})", envelope["signatures"].dump(), document.signed_bytes);
}

SignedBatch sign_batch(const Batch& batch, const PrivateKey& key) {
  json tiles = json::array();
  for (const BatchTile& tile : batch.tiles) tiles.push_back(json_from(tile));
  const json body{{"schema", kBatchSchema},
                  {"batch", batch.id},
                  {"airframe", batch.airframe},
                  {"flight", batch.flight},
                  {"base_package", batch.base_package.hex()},
                  {"created_at", to_rfc3339(batch.created_at)},
                  {"tiles", std::move(tiles)}};
  SignedBatch result{{}, {body.dump(), {}}};
  result.document.put(sign_payload(key, kBatchPayloadType, as_bytes(result.document.signed_bytes)));
  // A batch that a reader would refuse must not leave this function.
  return parse_batch(result.json(), "the new batch");
}

SignatureCheck check_batch_signature(const TrustRoot& root, const SignedBatch& batch, std::optional<UtcTime> at) {
  return check_tile_signatures(root, batch.batch.airframe, batch.document.signatures, kBatchPayloadType,
                               as_bytes(batch.document.signed_bytes), at, "batch " + batch.batch.id);
}

}  // namespace nadir
