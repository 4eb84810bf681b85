// The strict reader of batches.
#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <set>

#include "base/error.hpp"
#include "base/json.hpp"
#include "upload/batch.hpp"
#include "ortho/candidate_sidecar.hpp"
#include "trust/base64.hpp"

namespace nadir {
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

}  // namespace nadir
