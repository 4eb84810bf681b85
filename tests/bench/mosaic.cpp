// The orthophoto of photos by the poses that `nadir replay --adjust` wrote: how far its parts are displaced where they
// meet, and the steps of their levels there, as they were exposed and balanced (seams.hpp). Over level ground.
//
// Usage: bench_mosaic POSES.json FRAMES TELEMETRY.csv CAMERA.yaml SHRINK OUT
//   SHRINK: 1, 2, 4 or 8, of the photos. Writes OUT-as-exposed.png and OUT-balanced.png, prints JSON.
#include <fmt/format.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>

#include "base/files.hpp"
#include "imagery/codecs.hpp"
#include "imagery/frame_image.hpp"
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
  const FlatGround ground;
  const LocalFrame plane(document.subject.origin);
  nlohmann::json result;
  for (const bool balanced : {false, true}) {
    const std::string name = balanced ? "balanced" : "as-exposed";
    cv::Mat mosaic;
    result[name] =
        json_from(seams(camera, plane, ground, poses,
                        balanced ? balanced_images(camera, ground, poses, as_exposed) : as_exposed, &mosaic));
    write_file_atomic(fmt::format("{}-{}.png", argv[6], name), encode_image(mosaic, ImageFormat::png));
  }
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
