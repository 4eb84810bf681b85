#include "upload/batch.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <set>

#include "base/error.hpp"
#include "base/json.hpp"
#include "ortho/candidate_sidecar_parse.hpp"
#include "trust/base64.hpp"

namespace nadir {

// The strict reader of batches.

namespace {

using nlohmann::json;

[[noreturn]] void refuse(std::string_view name, std::string_view member, std::string expected, std::string found) {
  throw Error({.what = "cannot accept this batch",
               .where = fmt::format("{}: {}", name, member),
               .expected = std::move(expected),
               .found = std::move(found)});
}

void require_members(const json& object, std::initializer_list<const char*> members, std::string_view name,
                     std::string_view where) {
  if (!object.is_object()) refuse(name, where, "an object", object.type_name());
  for (const char* member : members) {
    if (!object.contains(member)) refuse(name, where, fmt::format("a member \"{}\"", member), "none");
  }
  if (object.size() != members.size()) refuse(name, where, "only members that this version knows", "others");
}

const std::string& text_of(const json& object, const char* member, std::string_view name, std::string_view where) {
  const json& value = object[member];
  if (!value.is_string()) refuse(name, fmt::format("{}/{}", where, member), "text", value.type_name());
  return value.get_ref<const std::string&>();
}

EnvelopeSignature read_signature(const json& tile, std::string_view name, std::string_view where) {
  EnvelopeSignature signature;
  signature.keyid = text_of(tile, "keyid", name, where);
  if (!Sha256::from_hex(signature.keyid)) refuse(name, where, "a keyid of 64 hexadecimal digits", "another text");
  const auto bytes = from_base64(text_of(tile, "sig", name, where));
  if (!bytes || bytes->size() != Signature{}.size())
    refuse(name, where, "a signature of 64 bytes in base64", "another");
  signature.signature = *bytes;
  return signature;
}

BatchTile read_tile(const json& item, const Batch& batch, std::string_view name, std::size_t index) {
  const std::string where = fmt::format("tiles/{}", index);
  require_members(item, {"sidecar", "keyid", "sig"}, name, where);
  BatchTile tile;
  tile.sidecar = read_candidate(item["sidecar"], fmt::format("{}: {}/sidecar", name, where));
  tile.sidecar_bytes = item["sidecar"].dump();
  tile.signature = read_signature(item, name, where);
  if (tile.sidecar.airframe != batch.airframe) refuse(name, where, "the batch's airframe", tile.sidecar.airframe);
  if (tile.sidecar.flight != batch.flight) refuse(name, where, "the batch's flight", tile.sidecar.flight);
  if (tile.sidecar.base_package != batch.base_package) {
    refuse(name, where, "the batch's base package", tile.sidecar.base_package.hex());
  }
  return tile;
}

Batch read_contents(const json& body, std::string_view name) {
  require_members(body, {"schema", "batch", "airframe", "flight", "base_package", "created_at", "tiles"}, name,
                  "signed");
  const auto text = [&](const char* member) -> const std::string& { return text_of(body, member, name, "signed"); };
  if (text("schema") != kBatchSchema) refuse(name, "schema", fmt::format("\"{}\"", kBatchSchema), text("schema"));
  Batch batch{text("batch"), text("airframe"), text("flight"), {}, {}, {}};
  if (!is_uuid(batch.id)) refuse(name, "batch", "a UUID in lower case", batch.id);
  const auto base = Sha256::from_hex(text("base_package"));
  if (!base) refuse(name, "base_package", "64 hexadecimal digits", text("base_package"));
  batch.base_package = *base;
  const auto created_at = parse_utc(text("created_at"));
  if (!created_at || to_rfc3339(*created_at) != text("created_at")) {
    refuse(name, "created_at", "a time like 2030-01-01T00:00:00Z", text("created_at"));
  }
  batch.created_at = *created_at;
  const json& tiles = body["tiles"];
  if (!tiles.is_array() || tiles.empty() || tiles.size() > kMaxBatchTiles) {
    refuse(name, "tiles", fmt::format("a list of 1 to {} tiles", kMaxBatchTiles),
           tiles.is_array() ? fmt::format("{}", tiles.size()) : tiles.type_name());
  }
  std::set<Sha256> seen;
  batch.tiles.reserve(tiles.size());
  for (const json& item : tiles) {
    batch.tiles.push_back(read_tile(item, batch, name, batch.tiles.size()));
    const Sha256& digest = batch.tiles.back().sidecar.sha256;
    if (!seen.insert(digest).second) refuse(name, "tiles", "each tile's digest once", digest.hex() + " twice");
  }
  return batch;
}

}  // namespace

SignedBatch read_batch(const json& document, std::string_view name) {
  SignedDocument split = split_signed_document(document, kBatchPayloadType, name);
  return {read_contents(document["signed"], name), std::move(split)};
}

SignedBatch parse_batch(std::string_view text, std::string_view name) {
  if (text.size() > kMaxBatchSize) {
    refuse(name, "its size", fmt::format("at most {} bytes", kMaxBatchSize), fmt::format("{}", text.size()));
  }
  return read_batch(parse_json(text, name, {.max_depth = 8, .allow_floats = false}), name);
}

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
