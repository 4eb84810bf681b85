#include "flight_adjustment/reconstruction_files.hpp"

#include <Eigen/Geometry>
#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>

#include "support/temporary_folder.hpp"

using namespace nadir;
using namespace nadir::test;

namespace {

// Two frames side by side that look down, and a point between them on the ground.
AdjustedFlight two_frames() {
  AdjustedFlight flight;
  CameraModel camera;
  camera.width = 400, camera.height = 300;
  camera.fx = camera.fy = 300, camera.cx = 199.5, camera.cy = 149.5;
  flight.summary.calibration.camera = flight.ties.camera = camera;
  flight.ties.points.emplace_back();
  AdjustedPoint& point = flight.block.points.emplace_back();
  point.used = true;
  point.position_m = {10, 5, 2};
  for (std::size_t i = 0; i < 2; ++i) {
    AdjustedFrame& frame = flight.block.frames.emplace_back();
    frame.pose.position = {20.0 * static_cast<double>(i), 0};
    frame.pose.agl_m = frame.up_m = 100;
    frame.pose.attitude.heading_rad = 0.3;
    Estimate& estimate = flight.estimates.emplace_back();
    estimate.frame = i == 0 ? "a.jpg" : "b.jpg";
    estimate.position = LonLat{8.5, 47.4};
    const Eigen::Vector3d centre(frame.pose.position.east_m, frame.pose.position.north_m, frame.up_m);
    const Eigen::Vector3d p = enu_from_camera(frame.pose.attitude).transpose() * (point.position_m - centre);
    flight.ties.points[0].push_back({i, camera.pixel_from_point(p)});
    point.observations.push_back({ObservationUse::used, {0.3, 0.4}});
  }
  return flight;
}

CameraModel twice_as_large(CameraModel camera) { return camera.scaled(2); }

}  // namespace

// What COLMAP computes from the files is where the point was seen.
TEST(ReconstructionFiles, TheirPointAppearsWhereItWasSeen) {
  const AdjustedFlight flight = two_frames();
  const auto files = reconstruction_files(flight, twice_as_large(flight.ties.camera));
  ASSERT_EQ(files.size(), 4U);
  std::istringstream cameras(files.at("cameras.txt")), images(files.at("images.txt")), points(files.at("points3D.txt"));
  std::string id, model;
  double width, height, fx, fy, cx, cy;
  cameras >> id >> model >> width >> height >> fx >> fy >> cx >> cy;
  EXPECT_EQ(model, "FULL_OPENCV");
  EXPECT_EQ(width, 800);
  double x, y, z, red, green, blue, error_px;
  points >> id >> x >> y >> z >> red >> green >> blue >> error_px;
  EXPECT_NEAR(error_px, 1.0, 1e-3);  // of 0.5 px at half the size
  for (std::string line; std::getline(images, line);) {
    std::istringstream head(line);
    double image, qw, qx, qy, qz, tx, ty, tz;
    head >> image >> qw >> qx >> qy >> qz >> tx >> ty >> tz;
    ASSERT_TRUE(std::getline(images, line));
    std::istringstream seen(line);
    double u, v, point;
    seen >> u >> v >> point;
    const Eigen::Vector3d p =
        Eigen::Quaterniond(qw, qx, qy, qz) * Eigen::Vector3d(x, y, z) + Eigen::Vector3d(tx, ty, tz);
    EXPECT_EQ(point, 1);
    EXPECT_NEAR(fx * p.x() / p.z() + cx, u, 0.01);
    EXPECT_NEAR(fy * p.y() / p.z() + cy, v, 0.01);
  }
  EXPECT_NE(files.at("geo.txt").find("a.jpg 8.500000000 47.400000000 100.000\n"), std::string::npos);
}

TEST(ReconstructionFiles, FramesWithoutAPositionAndOddNamesAreLeftOut) {
  AdjustedFlight flight = two_frames();
  flight.estimates[0].position.reset();
  flight.estimates[1].frame = "with a space.jpg";
  const auto files = reconstruction_files(flight, flight.ties.camera);
  EXPECT_TRUE(files.at("images.txt").empty());
  EXPECT_TRUE(files.at("points3D.txt").empty());
  EXPECT_EQ(files.at("geo.txt"), "EPSG:4326\n");
}

TEST(ReconstructionFiles, TheArchiveIsOneThatOthersRead) {
  const TemporaryFolder folder;
  const auto archive = folder.path() / "files.zip", script = folder.path() / "read.py";
  std::ofstream(archive, std::ios::binary)
      << zip_archive({{"a.txt", "first\n"}, {"b.txt", std::string(100'000, 'x')}, {"c.txt", ""}});
  std::ofstream(script) << "import sys, zipfile\n"
                           "z = zipfile.ZipFile(sys.argv[1])\n"
                           "assert z.testzip() is None\n"
                           "assert z.namelist() == ['a.txt', 'b.txt', 'c.txt']\n"
                           "assert z.read('a.txt') == b'first\\n' and len(z.read('b.txt')) == 100000\n";
  EXPECT_EQ(std::system(("python3 " + script.string() + " " + archive.string()).c_str()), 0);
}
