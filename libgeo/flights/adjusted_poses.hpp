// What an adjustment of a whole flight (flight_adjustment.hpp) determined beside positions: the attitudes and heights
// of its frames with their covariances, and the lens that belongs to them. The positions are the flight's adjusted
// estimates, stored in the same transaction.
//
// Covariances are of (east, north, up [m], turn about the camera's x, y and z axes [rad]), as in pose_covariance.hpp.
// Two frames that see a tie point together err together: of such pairs the covariance between them is stored too, so
// that an object that several frames show gets the ellipse that it deserves.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "vision/adjusted_lens.hpp"

namespace nadir {

class SqliteDatabase;

struct AdjustedPose {
  std::size_t frame = 0;
  Attitude attitude;
  double agl_m = 0;
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();  // the map's own error included
};

// Between two frames: of the parameters of `a` in rows, of `b` in columns; a > b.
struct AdjustedPosePair {
  std::size_t a = 0, b = 0;
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
};

struct AdjustedPoses {
  AdjustedLens lens;
  std::vector<AdjustedPose> frames;     // that have an adjusted position
  std::vector<AdjustedPosePair> pairs;  // of these
};

// Rows of the tables lens, pose and pose_covariance. Callers hold the store's lock, and a transaction for what changes.
// What is read back is checked: rows that nobody stored so are an Error, "the stored flight is damaged".
class PoseRows {
 public:
  // database: must outlive this.
  explicit PoseRows(const SqliteDatabase& database) : database_(database) {}

  void replace(const AdjustedPoses& poses) const;
  void remove_all() const;
  void remove(std::size_t frame) const;

  std::optional<AdjustedLens> lens() const;  // nothing: the flight has not been adjusted
  std::optional<AdjustedPose> pose(std::size_t frame) const;
  // Of these frames together, six rows each, in their order. Nothing where one has no pose, or two of them see no tie
  // point together.
  std::optional<Eigen::MatrixXd> joint_covariance(const std::vector<std::size_t>& frames) const;

 private:
  std::optional<Eigen::Matrix<double, 6, 6>> covariance(std::size_t a, std::size_t b) const;
  [[noreturn]] void refuse_damaged(const char* found, std::size_t frame) const;

  const SqliteDatabase& database_;
};

}  // namespace nadir
