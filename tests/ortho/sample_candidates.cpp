#include "ortho/sample_candidates.hpp"

#include "imagery/codecs.hpp"

namespace nadir::test {

CandidateSidecar sample_sidecar(const TileKey& key) {
  CandidateSidecar sidecar;
  sidecar.airframe = "mini-07";
  sidecar.flight = "2026-05-01_a";
  sidecar.base_package = sha256(as_bytes("manifest"));
  sidecar.frame = "frame_000042.jpg";
  sidecar.key = key;
  sidecar.sha256 = sha256(as_bytes("tile"));
  sidecar.size = 4;
  sidecar.captured_at = {1'777'636'800'250};
  sidecar.gsd_mm = 120;
  sidecar.pose = {.lat_e7 = 480'000'000,
                  .lon_e7 = 110'000'000,
                  .agl_mm = 150'000,
                  .heading_mdeg = 271'500,
                  .pitch_mdeg = -1200,
                  .roll_mdeg = 800,
                  .sigma_mm = 2000,
                  .cov_ee_mm2 = 4'000'000,
                  .cov_en_mm2 = -100'000,
                  .cov_nn_mm2 = 4'000'000,
                  .refined = true};
  sidecar.anchor_age_ms = 0;
  sidecar.quality = {60'000, 180'000, 1'000, 12'500, 1'000'000};
  sidecar.camera = sha256(as_bytes("camera"));
  return sidecar;
}

Candidate sample_candidate(const PrivateKey& key, const TileKey& at, int number, std::int64_t sigma_mm) {
  Candidate candidate;
  cv::Mat picture(kTileSize, kTileSize, CV_8UC3);
  for (int row = 0; row < picture.rows; ++row) {
    for (int column = 0; column < picture.cols; ++column) {
      const int value = (row * 7 + column * 3 + number * 31) % 256;
      picture.at<cv::Vec3b>(row, column) = cv::Vec3b(static_cast<std::uint8_t>(value), static_cast<std::uint8_t>(row),
                                                     static_cast<std::uint8_t>(255 - column));
    }
  }
  candidate.tile = encode_image(picture, ImageFormat::jpeg);
  candidate.sidecar = sample_sidecar(at);
  candidate.sidecar.sha256 = sha256(candidate.tile);
  candidate.sidecar.size = candidate.tile.size();
  candidate.sidecar.pose.sigma_mm = sigma_mm;
  candidate.sidecar_bytes = candidate_json(candidate.sidecar);
  candidate.signature = sign_candidate(key, candidate.sidecar_bytes);
  return candidate;
}

}  // namespace nadir::test
