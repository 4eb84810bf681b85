#include "simulation/world.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <opencv2/core.hpp>
#include <thread>

#include "base/error.hpp"
#include "simulation/picture_writer.hpp"
#include "simulation/world_documents.hpp"
#include "simulation/world_pictures.hpp"

namespace nadir {
namespace {

constexpr int kPiece = 1344;  // pixels; a piece and its rim stay within some hundred megabytes

void render_band(const Landscape& land, const Painter& painter, View view, double gsd_m, int first_row,
                 cv::Mat_<cv::Vec3b>& band) {
  const int pieces = (band.cols + kPiece - 1) / kPiece;
  std::atomic<int> next{0};
  std::exception_ptr failure;
  std::atomic<bool> failed{false};
  const auto work = [&] {
    for (int i = next++; i < pieces && !failed; i = next++) {
      try {
        const int left = i * kPiece, columns = std::min(kPiece, band.cols - left);
        const PixelGrid grid{gsd_m, land.size_m, left, first_row, columns, band.rows};
        render_view(land, painter, view, grid).copyTo(band.colRange(left, left + columns));
      } catch (...) {
        if (!failed.exchange(true)) failure = std::current_exception();
      }
    }
  };
  const auto workers = std::clamp<unsigned>(std::thread::hardware_concurrency(), 1, 8);
  {
    std::vector<std::jthread> threads;
    for (unsigned i = 1; i < workers; ++i) threads.emplace_back(work);
    work();
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace

WorldReport make_world(const WorldOptions& options, const std::filesystem::path& folder, Progress& progress) {
  const int side = static_cast<int>(std::lround(options.size_km * 1000 / options.gsd_m));
  const double size_m = side * options.gsd_m;
  const Landscape land = grow_landscape(options.seed, size_m);
  WorldReport report;
  report.side_px = side;
  report.parcels = land.fields.parcels.size();
  report.buildings = land.buildings.size();
  report.trees = land.trees.size();
  double low = 0, high = 0;
  cv::minMaxLoc(land.relief.heights_m, &low, &high);
  report.relief_m = high - low;
  report.map_ce90_m = map_ce90_m(land);

  const Placement placement = world_placement(size_m, options.gsd_m);
  const int bands = (side + kPiece - 1) / kPiece;
  progress.begin("painting", static_cast<std::uint64_t>(2 * bands), "strips");
  for (const View view : {View::day, View::satellite}) {
    const Painter painter(land, view == View::day ? Season::september : Season::may);
    PictureWriter writer(folder / (view == View::day ? "ground.tif" : "map.tif"), {side, side}, placement);
    for (int row = 0; row < side; row += kPiece) {
      cv::Mat_<cv::Vec3b> band(std::min(kPiece, side - row), side);
      render_band(land, painter, view, options.gsd_m, row, band);
      writer.write_rows(band);
      progress.advance(1);
    }
    writer.finish();
  }
  progress.end();
  Placement heights = placement;
  heights.gsd_m = land.relief.step_m;
  write_heights(folder / "dem.tif", land.relief.heights_m, heights);
  write_world_documents(land, options, placement, folder);
  return report;
}

}  // namespace nadir
