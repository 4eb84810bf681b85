#include "candidates/flight_maker.hpp"

#include <fmt/format.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "base/random.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir::test {
namespace {

constexpr int kMargin_px = 32;

// Ground as two scales of blobs, for a place of the world: drawn with a margin, so that it can be seen from beside.
cv::Mat ground_at(const TileKey& at, std::uint64_t seed) {
  Random random = Random(seed).fork("ground", (std::uint64_t{at.x} << 24) ^ at.y);
  const int side = kTileSize + 2 * kMargin_px;
  cv::Mat ground(side, side, CV_32FC1, cv::Scalar(0));
  for (const int cell : {6, 24}) {
    cv::Mat coarse(side / cell + 2, side / cell + 2, CV_32FC1), fine;
    for (int i = 0; i < static_cast<int>(coarse.total()); ++i) {
      coarse.ptr<float>(i / coarse.cols)[i % coarse.cols] = static_cast<float>(random.uniform(-1, 1));
    }
    cv::resize(coarse, fine, ground.size(), 0, 0, cv::INTER_CUBIC);
    ground += fine;
  }
  return ground;
}

}  // namespace

cv::Mat FlightMaker::picture(const TileKey& at) const {
  const cv::Mat ground = ground_at(at, options_.ground);
  const cv::Mat move = (cv::Mat_<double>(2, 3) << 1, 0, options_.off_px - kMargin_px, 0, 1, -kMargin_px);
  cv::Mat seen;
  cv::warpAffine(ground, seen, move, {kTileSize, kTileSize}, cv::INTER_LINEAR);
  Random random = Random(options_.noise).fork("noise", (std::uint64_t{at.x} << 24) ^ at.y);
  cv::Mat picture(kTileSize, kTileSize, CV_8UC3);
  for (int row = 0; row < kTileSize; ++row) {
    for (int column = 0; column < kTileSize; ++column) {
      const double value = 120 + 45 * static_cast<double>(seen.at<float>(row, column)) + random.uniform(-6, 6);
      const auto level = cv::saturate_cast<std::uint8_t>(value);
      picture.at<cv::Vec3b>(row, column) = {level, level, cv::saturate_cast<std::uint8_t>(value * 0.9)};
    }
  }
  return picture;
}

CandidateSidecar FlightMaker::sidecar_at(const TileKey& at) const {
  const LonLatBox box = bounds_of(at);
  CandidateSidecar sidecar;
  sidecar.airframe = options_.airframe;
  sidecar.flight = options_.flight;
  sidecar.base_package = options_.base_package;
  sidecar.frame = "000412.jpg";
  sidecar.key = at;
  sidecar.captured_at = {options_.captured_at.unix_s * 1000};
  sidecar.gsd_mm = 310;
  sidecar.camera = sha256(as_bytes("camera"));
  const auto e7 = [](double low, double high) {
    return static_cast<std::int64_t>(std::lround((low + high) / 2 * 1e7));
  };
  sidecar.pose = {.lat_e7 = e7(box.south_deg, box.north_deg),
                  .lon_e7 = e7(box.west_deg, box.east_deg),
                  .agl_mm = 400'000,
                  .heading_mdeg = 90'000,
                  .sigma_mm = options_.sigma_mm,
                  .cov_ee_mm2 = options_.sigma_mm * options_.sigma_mm,
                  .cov_nn_mm2 = options_.sigma_mm * options_.sigma_mm};
  sidecar.quality = {
      .sharpness_ppm = 400'000, .contrast_ppm = 190'000, .view_angle_mdeg = 12'000, .overlap_ppm = 1'000'000};
  return sidecar;
}

Candidate FlightMaker::sign(CandidateSidecar sidecar, Bytes tile) const {
  Candidate candidate;
  candidate.sidecar = std::move(sidecar);
  candidate.tile = std::move(tile);
  candidate.sidecar_bytes = candidate_json(candidate.sidecar);
  candidate.signature = sign_candidate(key_, candidate.sidecar_bytes);
  return candidate;
}

Candidate FlightMaker::candidate(const TileKey& at, const cv::Mat& picture) const {
  return encoded_candidate(at, encode_image(picture, ImageFormat::jpeg, 85));
}

Candidate FlightMaker::encoded_candidate(const TileKey& at, Bytes tile) const {
  CandidateSidecar sidecar = sidecar_at(at);
  sidecar.sha256 = sha256(tile);
  sidecar.size = tile.size();
  return sign(std::move(sidecar), std::move(tile));
}

Candidate FlightMaker::candidate(const TileKey& at) const { return candidate(at, picture(at)); }

Candidate FlightMaker::candidate(const TileKey& at, const std::function<void(CandidateSidecar&)>& change) const {
  Candidate candidate = this->candidate(at);
  change(candidate.sidecar);
  return sign(candidate.sidecar, candidate.tile);
}

SignedBatch FlightMaker::batch(const std::vector<Candidate>& candidates, int number) const {
  Batch batch;
  batch.id = fmt::format("0f8b4a52-6c1e-4d0b-9a7e-{:012x}", number);
  batch.airframe = options_.airframe;
  batch.flight = options_.flight;
  batch.base_package = options_.base_package;
  batch.created_at = {options_.captured_at.unix_s + 600};
  for (const Candidate& candidate : candidates) {
    batch.tiles.push_back({candidate.sidecar, candidate.sidecar_bytes, candidate.signature});
  }
  return sign_batch(batch, key_);
}

Bytes pack_of(const std::vector<Candidate>& candidates) {
  std::vector<PackEntry> entries;
  for (const Candidate& candidate : candidates) {
    entries.push_back({candidate.sidecar.sha256, static_cast<std::uint32_t>(candidate.tile.size())});
  }
  Bytes pack = pack_head(entries);
  for (const Candidate& candidate : candidates) pack.insert(pack.end(), candidate.tile.begin(), candidate.tile.end());
  return pack;
}

std::vector<TileKey> keys_in_a_row(std::uint32_t count, std::uint32_t row) {
  std::vector<TileKey> keys;
  for (std::uint32_t i = 0; i < count; ++i) keys.push_back({18, 137'412 + i, 91'874 + row});
  return keys;
}

std::string root_text(const std::vector<const FlightMaker*>& flights, const PrivateKey& signer, std::int64_t version,
                      const std::set<std::string>& revoked, UtcTime expires) {
  TrustRoot root;
  root.version = version;
  root.expires = expires;
  root.revoked = revoked;
  root.add_key(signer.public_key());
  root.root.key_ids.insert(signer.public_key().id());
  root.package_signer.key_ids.insert(signer.public_key().id());
  for (const FlightMaker* flight : flights) {
    root.add_key(flight->key().public_key());
    root.tile_signers[flight->options().airframe].key_ids.insert(flight->key().public_key().id());
  }
  return sign_root(std::move(root), {&signer}).json();
}

}  // namespace nadir::test
