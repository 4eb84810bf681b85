// The orthophoto of photos by the poses that `nadir replay --adjust` wrote: how far its parts are displaced where they
// meet, and the steps of their levels there (seams.hpp). Over level ground as they were exposed and balanced, and
// balanced over the shape of the ground that the photos themselves show (ortho/surface_model.hpp).
//
// Usage: bench_mosaic POSES.json FRAMES TELEMETRY.csv CAMERA.yaml SHRINK OUT
//   SHRINK: 1, 2, 4 or 8, of the photos. Writes OUT-as-exposed.png, OUT-balanced.png and OUT-own-surface.png, prints
//   JSON.
#include <fmt/format.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>

#include "base/files.hpp"
#include "imagery/codecs.hpp"
#include "imagery/frame_image.hpp"
#include "ortho/surface_model.hpp"
#include "replay/flight_folder.hpp"
#include "replay/poses_file.hpp"
#include "replay/score.hpp"
#include "seams.hpp"

namespace nadir::bench {
namespace {

void run(char** argv) {
  const PosesDocument document = parse_poses(as_text(read_file(argv[1])), argv[1]);
  const Flight flight = read_flight({argv[2], argv[3], argv[4]});
  const int shrink = std::atoi(argv[5]);
  const CameraModel& nominal = flight.camera.camera;
  const CameraModel camera = (document.lens ? document.lens->applied_to(nominal) : nominal).scaled(1.0 / shrink);
  FramePoses poses(flight.frames.size());
  for (const NumberedPose& each : document.poses) poses.at(each.index) = each.pose.pose;
  const BenchImageOf as_exposed = [&](std::size_t i) {
    return read_frame_file(flight.image_path(i), Colour::bgr, shrink);
  };
  const FlatGround level;
  const LocalFrame plane(document.subject.origin);
  NoProgress progress;
  SurfaceModelFigures made;
  const SurfaceModel shape = surface_from_frames(
      camera, level, poses, [&](std::size_t i) { return read_frame_file(flight.image_path(i), Colour::grey, shrink); },
      progress, &made);
  FramePoses over_shape = poses;
  for (auto& pose : over_shape) {
    if (pose) pose = shape.over_surface(*pose);
  }
  nlohmann::json result;
  const auto show = [&](const std::string& name, const GroundSurface& surface, const FramePoses& over_surface,
                        const BenchImageOf& image_of) {
    cv::Mat mosaic;
    result[name] = json_from(seams(camera, plane, surface, over_surface, image_of, &mosaic));
    write_file_atomic(fmt::format("{}-{}.png", argv[6], name), encode_image(mosaic, ImageFormat::png));
  };
  show("as-exposed", level, poses, as_exposed);
  show("balanced", level, poses, balanced_images(camera, level, poses, as_exposed));
  show("own-surface", shape, over_shape, balanced_images(camera, shape, over_shape, as_exposed));
  result["surface"] = {{"pairs", made.pairs},
                       {"measured", made.measured},
                       {"pixel_m", made.pixel_m},
                       {"along_px", made.along_px},
                       {"across_px", made.across_px}};
  fmt::print("{}\n", result.dump());
}

}  // namespace
}  // namespace nadir::bench

int main(int argc, char** argv) {
  if (argc != 7) {
    fmt::print(stderr, "usage: bench_mosaic POSES.json FRAMES TELEMETRY.csv CAMERA.yaml SHRINK OUT\n");
    return 2;
  }
  nadir::bench::run(argv);
  return 0;
}
