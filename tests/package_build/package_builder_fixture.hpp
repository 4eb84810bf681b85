// A small field, its mission and its map, and building packages of them: in this process, or in one that is killed.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "base/files.hpp"
#include "package_build/package_builder.hpp"
#include "raster/test_raster.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir::test {

// A field of 480 x 480 m with 8 m checks, seen at 0.3 m; the mission needs 200 x 200 m in its middle.
class PackageBuilder : public testing::Test {
 protected:
  PackageBuilder();

  void write_mission(int active_days = 400, int budget_mb = 50);
  void write_map(const std::string& name, std::array<int, 3> light = {210, 190, 150});  // with its STAC Item

  PackageRequest request(const std::string& out, int threads = 2);
  static PackageReport build(const PackageRequest& request);
  void expect_refused(const PackageRequest& request, std::string_view code);

  // Everything in the folder except the inputs: what a rejected or failed build must not leave.
  std::vector<std::string> left_behind() const;
  static void expect_same_files(const std::filesystem::path& a, const std::filesystem::path& b);

  // In a process of its own, as another user when a uid is given. event: of the progress, at which it kills itself; 0:
  // never.
  static constexpr int kFirstTiles = 2;  // after `begin`
  ProcessResult run_build(const PackageRequest& wanted, int event, const std::string& uid = {});
  void build_and_kill(const PackageRequest& wanted, int event);

  TemporaryFolder folder_;
  RasterSpec spec_;
  std::function<bool(int, int)> hole_;
  PrivateKey key_ = PrivateKey::read(create_key_files(folder_ / "map").private_key);
  std::string polygon_, takeoff_, route_;
};

// A build of many steps: tiles of the two finest zooms are single metatiles each with min = max - 3.
class ResumedBuild : public PackageBuilder {
 protected:
  ResumedBuild() {
    spec_.width = spec_.height = 1000;  // less of the same field
    (*spec_.transform)[0] += 90, (*spec_.transform)[3] -= 90;
    spec_.nodata = 0;
    hole_ = [](int column, int row) { return column < 30 || row > 980; };  // masks take part
    write_map("map.tif");
    std::string text = read_text_file(folder_ / "mission.yaml");
    text.replace(text.find("max: 19"), 7, "max: 20");
    folder_.write("mission.yaml", text);
  }

  PackageRequest resuming(const std::string& out, int threads = 2) {
    PackageRequest wanted = request(out, threads);
    wanted.resume = true;
    wanted.on_remark = [this](std::string_view remark) { remarks_.emplace_back(remark); };
    return wanted;
  }

  std::vector<std::string> remarks_;
};

}  // namespace nadir::test
