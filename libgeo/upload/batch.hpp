// The announcement of an upload: the candidate tiles of one flight (as many as one document holds), with their sidecars
// as they were signed in flight, signed once more as a whole by the airframe's tile key:
//   {"signed": {"schema": "nadir.batch/1", "batch", "airframe", "flight", "base_package", "created_at",
//    "tiles": [{"sidecar": {…}, "keyid", "sig"}…]}, "signatures": [{"keyid", "sig"}]}
// schemas/candidates.openapi.yaml is the reference. Whole numbers and texts only, no member twice, none unknown.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "ortho/candidate_sidecar.hpp"
#include "trust/signed_document.hpp"

namespace nadir {

inline constexpr std::string_view kBatchSchema = "nadir.batch/1";
inline constexpr std::string_view kBatchPayloadType = "application/vnd.nadir.candidate-batch.v1+json";
inline constexpr std::size_t kMaxBatchTiles = 2000;
inline constexpr std::uint64_t kMaxBatchSize = std::uint64_t{4} << 20;  // bytes, of the whole document

struct BatchTile {
  CandidateSidecar sidecar;
  std::string sidecar_bytes;  // canonical: what was signed
  EnvelopeSignature signature;
};

struct Batch {
  std::string id;        // a UUID in lower case; also the upload's Idempotency-Key
  std::string airframe;  // these three are those of every tile
  std::string flight;
  Sha256 base_package;
  UtcTime created_at;
  std::vector<BatchTile> tiles;  // no digest twice
};

struct SignedBatch {
  Batch batch;
  SignedDocument document;

  std::string json() const;  // the body that is sent: no blanks
};

// A random UUID (RFC 9562, version 4) from 16 random bytes, and whether a text is any UUID in its canonical form.
std::string uuid_from(std::array<std::uint8_t, 16> random);
bool is_uuid(std::string_view text);

// Bytes that a tile adds to a batch's document, so that batches can be filled up.
std::uint64_t batch_share(const BatchTile& tile);
inline constexpr std::uint64_t kBatchFrame = 1024;  // bytes, more than everything around the tiles

// Throws Error for what parse_batch() would refuse.
SignedBatch sign_batch(const Batch& batch, const PrivateKey& key);

// Form only; throws Error, naming the member. read_batch() takes a document that parse_json() built without floats.
SignedBatch parse_batch(std::string_view text, std::string_view name);
SignedBatch read_batch(const nlohmann::json& document, std::string_view name);

// Signed by a key that the root gives to the airframe that it names? at: nullopt skips the expiry of keys.
SignatureCheck check_batch_signature(const TrustRoot& root, const SignedBatch& batch, std::optional<UtcTime> at);

}  // namespace nadir
