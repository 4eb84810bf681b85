#include "flights/adjusted_poses.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "base/bytes.hpp"
#include "base/error.hpp"
#include "geodesy/angles.hpp"
#include "imagery/sqlite_database.hpp"

namespace nadir {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are written as they lie in memory");

using Covariance = Eigen::Matrix<double, 6, 6>;

constexpr double kMaxAgl_m = 100'000;

std::int64_t row_number(std::size_t frame) { return static_cast<std::int64_t>(frame); }

ByteView bytes_of(const Covariance& covariance) {
  return {reinterpret_cast<const std::uint8_t*>(covariance.data()), sizeof(double) * 36};
}

}  // namespace

void PoseRows::refuse_damaged(const char* found, std::size_t frame) const {
  throw Error({.what = "the stored flight is damaged",
               .where = database_.path(),
               .expected = "rows as they were stored",
               .found = fmt::format("{} of frame {}", found, frame),
               .fix = "get the flight from a backup, or complete it again"});
}

void PoseRows::remove_all() const {
  for (const char* table : {"pose", "pose_covariance", "lens"}) {
    database_.prepare(fmt::format("DELETE FROM {}", table)).run();
  }
}

void PoseRows::remove(std::size_t frame) const {
  database_.prepare("DELETE FROM pose WHERE frame = ?").bind(1, row_number(frame)).run();
  database_.prepare("DELETE FROM pose_covariance WHERE frame = ? OR other = ?")
      .bind(1, row_number(frame))
      .bind(2, row_number(frame))
      .run();
}

void PoseRows::replace(const AdjustedPoses& poses) const {
  remove_all();
  auto lens = database_.prepare("INSERT INTO lens (id, log_focal, k1, k2, p1, p2, k3) VALUES (1, ?, ?, ?, ?, ?, ?)");
  lens.bind_real(1, poses.lens.log_focal);
  for (std::size_t i = 0; i < 5; ++i) lens.bind_real(static_cast<int>(i) + 2, poses.lens.distortion.at(i));
  lens.run();
  auto pose =
      database_.prepare("INSERT INTO pose (frame, heading_deg, pitch_deg, roll_deg, agl_m) VALUES (?, ?, ?, ?, ?)");
  auto covariance = database_.prepare("INSERT INTO pose_covariance (frame, other, covariance) VALUES (?, ?, ?)");
  for (const AdjustedPose& frame : poses.frames) {
    pose.bind(1, row_number(frame.frame)).bind_real(2, degrees(frame.attitude.heading_rad));
    pose.bind_real(3, degrees(frame.attitude.pitch_rad)).bind_real(4, degrees(frame.attitude.roll_rad));
    pose.bind_real(5, frame.agl_m).run();
    covariance.bind(1, row_number(frame.frame)).bind(2, row_number(frame.frame)).bind(3, bytes_of(frame.covariance));
    covariance.run();
  }
  for (const AdjustedPosePair& pair : poses.pairs) {
    covariance.bind(1, row_number(pair.a)).bind(2, row_number(pair.b)).bind(3, bytes_of(pair.covariance)).run();
  }
}

std::optional<AdjustedLens> PoseRows::lens() const {
  auto row = database_.prepare("SELECT log_focal, k1, k2, p1, p2, k3 FROM lens");
  if (!row.step()) return std::nullopt;
  AdjustedLens lens;
  lens.log_focal = row.real(0);
  bool valid = std::abs(lens.log_focal) <= kMostLensLogFocal;
  for (std::size_t i = 0; i < 5; ++i) {
    lens.distortion.at(i) = row.real(static_cast<int>(i) + 1);
    valid = valid && std::abs(lens.distortion.at(i)) <= kMostLensDistortion;
  }
  if (!valid) refuse_damaged("an impossible lens", 0);
  return lens;
}

std::optional<Covariance> PoseRows::covariance(std::size_t a, std::size_t b) const {
  auto row = database_.prepare("SELECT covariance FROM pose_covariance WHERE frame = ? AND other = ?");
  if (!row.bind(1, row_number(a)).bind(2, row_number(b)).step()) return std::nullopt;
  const ByteView blob = row.blob(0);
  Covariance covariance;
  if (blob.size() != bytes_of(covariance).size()) refuse_damaged("a covariance of another size", a);
  std::memcpy(covariance.data(), blob.data(), blob.size());
  if (!covariance.allFinite()) refuse_damaged("a covariance that is not finite", a);
  return covariance;
}

std::optional<AdjustedPose> PoseRows::pose(std::size_t frame) const {
  auto row = database_.prepare("SELECT heading_deg, pitch_deg, roll_deg, agl_m FROM pose WHERE frame = ?");
  if (!row.bind(1, row_number(frame)).step()) return std::nullopt;
  const auto own = covariance(frame, frame);
  AdjustedPose pose{.frame = frame,
                    .attitude = {radians(row.real(0)), radians(row.real(1)), radians(row.real(2))},
                    .agl_m = row.real(3),
                    .covariance = own.value_or(Covariance::Zero())};
  const Attitude& attitude = pose.attitude;
  const double turned_rad = std::abs(attitude.heading_rad) + std::abs(attitude.pitch_rad) + std::abs(attitude.roll_rad);
  if (!own || !(turned_rad <= 6 * kPi) || !(pose.agl_m > 0 && pose.agl_m <= kMaxAgl_m)) {
    refuse_damaged("an impossible pose", frame);
  }
  if (!own->isApprox(own->transpose(), 1e-9) || (own->diagonal().array() < 0).any()) {
    refuse_damaged("a matrix that is no covariance", frame);
  }
  return pose;
}

std::optional<Eigen::MatrixXd> PoseRows::joint_covariance(const std::vector<std::size_t>& frames) const {
  const auto size = static_cast<Eigen::Index>(6 * frames.size());
  Eigen::MatrixXd joint(size, size);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(6 * i);
    for (std::size_t j = 0; j <= i; ++j) {
      const auto found = covariance(std::max(frames[i], frames[j]), std::min(frames[i], frames[j]));
      if (!found) return std::nullopt;
      const Covariance ordered = frames[i] >= frames[j] ? *found : Covariance(found->transpose());
      const auto column = static_cast<Eigen::Index>(6 * j);
      joint.block<6, 6>(row, column) = ordered;
      joint.block<6, 6>(column, row) = ordered.transpose();
    }
  }
  return joint;
}

}  // namespace nadir
