// Flights over made-up ground, for a candidate service: keys, a trust root, signed candidates, batches and packs. The
// same place looks alike to every flight, but for noise, light, and how far the flight is off.
#pragma once

#include <functional>
#include <set>

#include "base/time.hpp"
#include "ortho/candidate_store.hpp"
#include "trust/root.hpp"
#include "upload/batch.hpp"
#include "upload/pack.hpp"

namespace nadir::test {

inline constexpr UtcTime kNoon{1'795'000'000};  // 2026-11-18
inline constexpr std::int64_t kDay_s = 86'400;

struct FlightOptions {
  std::string airframe = "mini-07";
  std::string flight = "flight-1";
  UtcTime captured_at = kNoon;
  double off_px = 0;         // east, of its images
  std::uint64_t ground = 1;  // which ground is seen
  std::uint64_t noise = 1;   // seed of the sensor's noise
  std::int64_t sigma_mm = 1'500;
  Sha256 base_package = sha256(as_bytes("base"));
};

class FlightMaker {
 public:
  explicit FlightMaker(FlightOptions options = {}, PrivateKey key = PrivateKey::generate())
      : options_(std::move(options)), key_(std::move(key)) {}

  Candidate candidate(const TileKey& at) const;
  // With another image, or after a change of the sidecar.
  Candidate candidate(const TileKey& at, const cv::Mat& picture) const;
  Candidate candidate(const TileKey& at, const std::function<void(CandidateSidecar&)>& change) const;
  Candidate encoded_candidate(const TileKey& at, Bytes tile) const;
  cv::Mat picture(const TileKey& at) const;  // BGR

  // number: part of the batch's id.
  SignedBatch batch(const std::vector<Candidate>& candidates, int number = 1) const;

  const PrivateKey& key() const { return key_; }
  FlightOptions& options() { return options_; }
  const FlightOptions& options() const { return options_; }

 private:
  Candidate sign(CandidateSidecar sidecar, Bytes tile) const;
  CandidateSidecar sidecar_at(const TileKey& at) const;

  FlightOptions options_;
  PrivateKey key_;
};

Bytes pack_of(const std::vector<Candidate>& candidates);

// Tiles side by side, from 18/137412/91874 on.
std::vector<TileKey> keys_in_a_row(std::uint32_t count, std::uint32_t row = 0);

// A root that gives each airframe its flights' keys; signed by `signer`.
std::string root_text(const std::vector<const FlightMaker*>& flights, const PrivateKey& signer,
                      std::int64_t version = 1, const std::set<std::string>& revoked = {},
                      UtcTime expires = UtcTime{2'000'000'000});

}  // namespace nadir::test
