#include "upload/batch.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <set>

#include "base/bytes.hpp"
#include "base/error.hpp"
#include "base/json.hpp"
#include "ortho/candidate_sidecar.hpp"

namespace nadir {
namespace {

using nlohmann::json;

json json_from(const BatchTile& tile) {
  return {{"sidecar", json::parse(tile.sidecar_bytes)},
          {"keyid", tile.signature.keyid},
          {"sig", to_base64(tile.signature.signature)}};
}

// Strict: whole numbers and texts only (parse_json()), no member twice, none unknown.
JsonReader::Subject subject(std::string_view name) {
  return {.name = std::string(name), .what = "cannot accept this batch"};
}

BatchTile read_tile(const JsonReader& in, const Batch& batch) {
  BatchTile tile;
  tile.sidecar = read_candidate(in.value("sidecar"), in.where("sidecar"));
  tile.sidecar_bytes = in.json()["sidecar"].dump();
  tile.signature = read_signature(in);
  in.finish();
  if (tile.sidecar.airframe != batch.airframe) in.refuse("sidecar", "the batch's airframe", tile.sidecar.airframe);
  if (tile.sidecar.flight != batch.flight) in.refuse("sidecar", "the batch's flight", tile.sidecar.flight);
  if (tile.sidecar.base_package != batch.base_package) {
    in.refuse("sidecar", "the batch's base package", tile.sidecar.base_package.hex());
  }
  return tile;
}

Batch read_contents(const JsonReader& in) {
  in.expect("schema", kBatchSchema);
  Batch batch{in.text("batch"), in.text("airframe"), in.text("flight"), {}, {}, {}};
  if (!is_uuid(batch.id)) in.refuse("batch", "a UUID in lower case");
  batch.base_package = in.digest("base_package");
  batch.created_at = in.time("created_at");
  if (to_rfc3339(batch.created_at) != in.text("created_at")) {
    in.refuse("created_at", "a time like 2030-01-01T00:00:00Z");
  }
  const JsonReader tiles = in.array("tiles", {.least = 1, .most = kMaxBatchTiles});
  in.finish();
  std::set<Sha256> seen;
  batch.tiles.reserve(tiles.size());
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    batch.tiles.push_back(read_tile(tiles.object(i), batch));
    const Sha256& digest = batch.tiles.back().sidecar.sha256;
    if (!seen.insert(digest).second) in.refuse("tiles", "each tile's digest once", digest.hex() + " twice");
  }
  return batch;
}

}  // namespace

SignedBatch read_batch(const json& document, std::string_view name) {
  SignedDocument split = split_signed_document(document, name);
  const JsonReader in(document, subject(name));
  return {read_contents(in.object("signed")), std::move(split)};
}

SignedBatch parse_batch(std::string_view text, std::string_view name) {
  if (text.size() > kMaxBatchSize) {
    throw Error({.what = "cannot accept this batch",
                 .where = std::string(name),
                 .expected = fmt::format("at most {} bytes", kMaxBatchSize),
                 .found = fmt::format("{} bytes", text.size())});
  }
  return read_batch(parse_json(text, name, {.max_depth = 8, .allow_floats = false}), name);
}

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
