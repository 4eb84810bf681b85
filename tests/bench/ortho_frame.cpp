// One frame with a given pose as map tiles, and the CPU time of each step: Nadir's side of ortho.py.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <nlohmann/json.hpp>
#include <opencv2/core/utility.hpp>

#include "base/files.hpp"
#include "cpu_time.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"
#include "ortho/orthorectifier.hpp"
#include "vision/camera.hpp"

using namespace nadir;
using bench::cpu_ms;

int main(int argc, char** argv) {
  CLI::App app("Orthorectifies one frame over flat ground.", "ortho_frame");
  std::filesystem::path camera_path, frame_path, out;
  double lon = 0, lat = 0, agl_m = 100, heading = 0, pitch = 0, roll = 0;
  int zoom = 19, repeat = 7;
  app.add_option("--camera", camera_path)->required();
  app.add_option("--frame", frame_path)->required();
  app.add_option("--out", out, "folder for the tiles, PNG")->required();
  app.add_option("--lon", lon)->required();
  app.add_option("--lat", lat)->required();
  app.add_option("--agl-m", agl_m)->required();
  app.add_option("--heading-deg", heading)->required();
  app.add_option("--pitch-deg", pitch)->required();
  app.add_option("--roll-deg", roll)->required();
  app.add_option("--zoom", zoom)->capture_default_str();
  app.add_option("--repeat", repeat, "the least time of so many counts")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    cv::setNumThreads(1);
    const CameraModel camera = read_camera_file(camera_path).camera;
    const Bytes encoded = read_file(frame_path);
    const LocalFrame frame({lon, lat});
    const CameraPose pose{{0, 0}, agl_m, {radians(heading), radians(pitch), radians(roll)}};
    const double tile_gsd_m = ground_resolution_m(zoom, lat);
    const int shrink = decoding_shrink(camera, agl_m, tile_gsd_m);
    double decode_ms = 1e9, ortho_ms = 1e9;
    std::vector<OrthoTile> tiles;
    for (int i = 0; i < repeat; ++i) {
      const double start = cpu_ms();
      const cv::Mat picture = decode_image(encoded, Colour::bgr, "frame", shrink).image;
      const double decoded = cpu_ms();
      const ReducedFrame reduced = reduce_frame(picture, camera.scaled(1.0 / shrink), agl_m, tile_gsd_m);
      tiles = orthorectify(reduced, whole_tiles(zoom, frame, reduced.camera, pose, FlatGround()));
      ortho_ms = std::min(ortho_ms, cpu_ms() - decoded);
      decode_ms = std::min(decode_ms, decoded - start);
    }
    nlohmann::json keys = nlohmann::json::array();
    for (const OrthoTile& tile : tiles) {
      const std::string name = std::to_string(tile.key.x) + "-" + std::to_string(tile.key.y) + ".png";
      write_file_atomic(out / name, encode_image(tile.image, ImageFormat::png));
      keys.push_back({{"x", tile.key.x}, {"y", tile.key.y}, {"file", name}});
    }
    std::cout << nlohmann::json{{"decode_ms", decode_ms}, {"ortho_ms", ortho_ms}, {"shrink", shrink}, {"tiles", keys}}
              << "\n";
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "ortho_frame: " << error.what() << "\n";
    return 2;
  }
}
