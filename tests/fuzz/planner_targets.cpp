// What the planner and the replay read: STAC Items, drawings, cameras, telemetry, poses, terrain, images.
#include <array>
#include <cmath>

#include "datasets/numpy_arrays.hpp"
#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"
#include "imagery/codecs.hpp"
#include "imagery/frame_image.hpp"
#include "imagery/matchability_raster.hpp"
#include "imagery/terrain_raster.hpp"
#include "mission_formats/mavlink_plans.hpp"
#include "mission_formats/mission_drawing.hpp"
#include "package_build/matchability_survey.hpp"
#include "package_build/metatile.hpp"
#include "package_build/shard_plan.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/gdal_drivers.hpp"
#include "raster/imagery_input.hpp"
#include "raster/stac.hpp"
#include "raster/tile_package.hpp"
#include "replay/flight_folder.hpp"
#include "replay/inertial_file.hpp"
#include "replay/poses_file.hpp"
#include "vision/camera.hpp"
#include "vision/place_index_builder.hpp"

namespace nadir::fuzz {

void stac_item(std::string_view bytes) {
  const std::filesystem::path item = scratch_file("map.json", bytes);
  refusing([&] {
    const ImageryFacts facts = read_imagery_facts(scratch_folder() / "map.tif", {});
    require(facts.gsd_m > 0 && std::isfinite(facts.gsd_m), "a resolution that is none");
    require(facts.ce90_m > 0 && std::isfinite(facts.ce90_m), "an accuracy that is none");
    require(parse_utc(to_rfc3339(facts.captured_at)) == facts.captured_at, "a date changes when it is written");
  });
}

// What is accepted is written as a list that says the same. No document lies behind its links but itself.
void stac_list(std::string_view bytes) {
  const std::string first = scratch_file("list.json", bytes).string();
  const std::string second = (scratch_folder() / "again.json").string();
  refusing([&] {
    const std::vector<StacAsset> assets = read_stac(first);
    if (assets.front().tiled()) return;  // which no list can hold
    const std::string text = stac_list_json(assets);
    scratch_file("again.json", text);
    const std::vector<StacAsset> again = read_stac(second);
    require(again.size() == assets.size() && stac_list_json(again) == text, "a list changes when it is written");
    for (std::size_t i = 0; i < assets.size(); ++i) {
      require(again[i].href == assets[i].href && again[i].pin == assets[i].pin, "another object");
    }
  });
}

// What is accepted can be read from corner to corner, or says why not.
void tiled_assets(std::string_view bytes) {
  static const std::filesystem::path tile =
      scratch_file("tile.png", as_text(encode_image(cv::Mat(4, 4, CV_8UC3, cv::Scalar(1, 2, 3)), ImageFormat::png)));
  const std::filesystem::path item = scratch_file("tiles.json", bytes);
  refusing([&] {
    const GdalDataset dataset(item);
    require(files_of_raster(item).size() > 1, "tiles without files");
    const cv::Size size = dataset.size();
    for (const cv::Point corner : {cv::Point(0, 0), cv::Point(size.width - 1, size.height - 1)}) {
      refusing([&] { dataset.read({corner, cv::Size(1, 1)}, {1, 1}); });
    }
  });
}

namespace {

void drawing(std::string_view name, std::string_view bytes) {
  refusing([&] { read_mission_drawing(scratch_file(name, bytes)); });
}

}  // namespace

// What is accepted is written as the same bytes, once it has been written at all.
void shard_plan(std::string_view bytes) {
  static constexpr std::string_view kMission = R"(schema: nadir.mission/1
id: fuzz
series: fuzz
sequence: 1
created: 2024-10-30T00:00:00Z
expires: 2024-11-30T00:00:00Z
takeoff: {lon_deg: 8.5, lat_deg: 47.4}
terrain: {mode: flat}
zoom: {min: 16, max: 18}
min_resolution_m: 1.0
budget_mb: 50
freshness_days: {stable: 730, active: 400}
airframes: [any]
sectors:
  - {id: field, class: stable, polygon: [[8.4985, 47.3990], [8.5015, 47.3990], [8.5015, 47.4010], [8.4985, 47.3990]]}
route: {corridor_half_width_m: 40, agl_m: 100, points: [[8.4990, 47.4000], [8.5010, 47.4000]]}
)";
  refusing([&] {
    const std::string once = shard_plan_json(parse_shard_plan(bytes, kMission, "plan.json"));
    const ShardPlan plan = parse_shard_plan(once, kMission, "plan.json");
    require(shard_plan_json(plan) == once, "a plan changes when it is written");
    std::size_t next = 0;
    for (const MetatileSpan& part : plan.shards) {
      require(part.first == next && part.last >= part.first, "shards with gaps");
      next = part.last;
    }
  });
}

void metatile(std::string_view bytes) {
  Bytes record(bytes.begin(), bytes.end());
  for (const int channels : {3, 1}) {  // colours, mask
    const auto size = static_cast<std::uint64_t>(kTilePixels * channels);
    for (int shift = 56; shift >= 0; shift -= 8) record.push_back(static_cast<std::uint8_t>(size >> shift));
    record.resize(record.size() + size, 7);
  }
  const std::optional<Metatile> metatile = parse_metatile(record);
  require(!metatile || serialize_metatile(*metatile) == record, "a metatile changes when it is written");
}

// First byte: how many chunks.
void shard_result(std::string_view bytes) {
  if (bytes.empty()) return;
  const ByteView record = as_bytes(bytes.substr(1));
  const auto same = [&](const Bytes& written) {
    return std::equal(written.begin(), written.end(), record.begin(), record.end());
  };
  const auto chunks = parse_chunks(record, static_cast<std::uint8_t>(bytes[0]));
  require(!chunks || same(serialize_chunks(*chunks)), "chunks change when they are written");
  const auto place = parse_place(record);
  require(!place || same(serialize_place(*place)), "a place changes when it is written");
}

// Whatever a VRT names, also itself, and however deeply: it is read to its end or refused.
void vrt(std::string_view bytes) {
  const std::filesystem::path file = scratch_file("map.vrt", bytes);
  refusing([&] { refuse_remote_raster(file); });
}

// Every tile of the list is there, and of its size.
void tile_package(std::string_view bytes) {
  const InputFile file(scratch_file("map.tpkx", bytes));
  refusing([&] {
    const TilePackageReader package(file);
    const std::vector<TileKey> keys = package.keys();
    require(!keys.empty(), "a package without tiles");
    for (const TileKey& key : keys)
      refusing([&] { require(package.read(key).has_value(), "a tile is listed and missing"); });
  });
}

// What is accepted lies inside the file: its values can be read, one by one as well.
void numpy_array(std::string_view bytes) {
  refusing([&] {
    const NumpyArray array(Bytes(bytes.begin(), bytes.end()), "array.npy");
    const std::size_t count = array.header().count();
    require(array.header().begin + count * array.header().value_size() <= bytes.size(), "values beyond the file");
    refusing([&] { require(array.numbers(count).size() == count, "another number of values"); });
    refusing([&] { array.text(); });
    const NumpyRaster raster(scratch_file("array.npy", bytes));
    for (const std::ptrdiff_t at : {-1, 0, 1, 1 << 20}) {
      const auto value = raster.at(at, at);
      require(!value || std::isfinite(*value), "a height that is none");
    }
  });
}

void kml(std::string_view bytes) { drawing("plan.kml", bytes); }
void geojson(std::string_view bytes) { drawing("plan.geojson", bytes); }

namespace {

// What is accepted must give the same mission when it is written and read again.
void planned(const MissionDrawing& drawing) {
  for (const DrawnLine& line : drawing.lines) {
    require(line.heights_m.empty() || line.heights_m.size() == line.points.size(), "another number of heights");
    for (const LonLat& at : line.points) {
      require(std::abs(at.lon_deg) <= 180 && std::abs(at.lat_deg) <= 90, "a place outside of the world");
    }
    for (const double height_m : line.heights_m) require(std::isfinite(height_m), "a height that is none");
  }
  MissionImportOptions options;
  options.id = "fuzz";
  refusing([&] {
    const ImportedMission imported = mission_from_drawing(drawing, options, "fuzz");
    if (!imported.reading.mission || imported.reading.mission->route.points.empty()) return;
    const Mission& mission = *imported.reading.mission;
    const ImportedMission again = mission_from_drawing(read_plan(mission_as_plan(mission), "again"), {}, "again");
    require(again.reading.mission == mission, "a mission changes when it is written");
  });
}

}  // namespace

void plan(std::string_view bytes) {
  refusing([&] { planned(read_plan(bytes, "fuzz")); });
}

void waypoints(std::string_view bytes) {
  refusing([&] { planned(read_waypoints(bytes, "fuzz")); });
}

void camera(std::string_view bytes) {
  refusing([&] {
    const CameraModel model = read_camera_file(scratch_file("camera.yaml", bytes)).camera;
    require(model.width > 0 && model.height > 0 && model.fx > 0 && model.fy > 0, "a camera that sees nothing");
    const Eigen::Vector3d ray = model.ray_from_pixel({model.cx, model.cy});
    require(ray.allFinite(), "a ray that is none");
  });
}

void telemetry(std::string_view bytes) {
  refusing([&] {
    const auto rows = read_telemetry(scratch_file("telemetry.csv", bytes));
    require(!rows.empty(), "a table without rows is accepted");
    for (std::size_t i = 0; i < rows.size(); ++i) {
      require(std::isfinite(rows[i].time_s), "a time that is none");
      require(i == 0 || rows[i].time_s > rows[i - 1].time_s, "rows out of the order of time");
    }
  });
}

void inertial(std::string_view bytes) {
  refusing([&] {
    const auto samples = read_inertial(scratch_file("imu.csv", bytes));
    for (std::size_t i = 1; i < samples.size(); ++i) {
      require(samples[i].time_s > samples[i - 1].time_s, "samples out of the order of time");
    }
    const double from_s = samples.front().time_s, to_s = std::min(samples.back().time_s, from_s + 10);
    for (const PreintegratedMotion& part : preintegrate_parts(usable_samples(samples, from_s), from_s, to_s)) {
      require(part.turn.allFinite() && part.displacement_m.allFinite() && part.covariance.allFinite(),
              "a motion that is none");
    }
  });
}

void poses(std::string_view bytes) {
  refusing([&] {
    const PosesDocument read = parse_poses(bytes, "fuzz");
    for (std::size_t i = 0; i < read.poses.size(); ++i) {
      const NumberedPose& one = read.poses[i];
      require(one.index < read.subject.frames, "a pose of a frame that the flight does not have");
      require(i == 0 || one.index > read.poses[i - 1].index, "poses out of order");
      require(std::isfinite(one.pose.sigma_m) && one.pose.sigma_m >= 0, "a sigma that is none");
    }
    const std::string written = poses_json(read);
    require(poses_json(parse_poses(written, "again")) == written, "poses change when they are written");
  });
}

void terrain(std::string_view bytes) {
  refusing([&] {
    const TerrainRaster raster = parse_terrain_raster(as_bytes(bytes), "fuzz");
    const TerrainGrid& grid = raster.grid();
    require(raster.heights_m().size() == grid.posts(), "another number of heights than posts");
    for (const double at : {-1.0, 0.0, 0.5, grid.columns - 1.0, grid.columns + 1.0}) {
      const auto height_m = raster.height_m(grid.place(at, at));
      require(!height_m || std::isfinite(*height_m), "a height that is none");
    }
  });
}

void matchability(std::string_view bytes) {
  refusing([&] {
    const MatchabilityCells cells = parse_matchability_raster(as_bytes(bytes), "fuzz").cells();
    require(cells.classes.size() == static_cast<std::size_t>(cells.columns) * static_cast<std::size_t>(cells.rows),
            "another number of classes than cells");
    for (const MatchClass cls : cells.classes) require(cls <= MatchClass::poor, "a class that is none");
  });
}

void picture(std::string_view bytes) {
  refusing([&] {
    const FrameSize info = read_frame_size(as_bytes(bytes), "fuzz");
    require(info.width > 0 && info.height > 0, "a picture without pixels");
    if (std::int64_t{info.width} * info.height > 1'000'000) return;  // allowed, but slow
    for (const int shrink : {1, 2, 8}) {
      for (const Colour colour : {Colour::bgr, Colour::grey}) {
        refusing([&] {
          const cv::Mat image = decode_frame(as_bytes(bytes), colour, "fuzz", shrink);
          require(image.cols == (info.width + shrink - 1) / shrink, "another width than the header's");
          require(image.rows == (info.height + shrink - 1) / shrink, "another height than the header's");
          if (is_tiff(as_bytes(bytes))) return;
          const DecodedImage whole = decode_image(as_bytes(bytes), colour, "fuzz", shrink);
          require(whole.alpha.empty() || whole.alpha.size() == whole.image.size(), "a mask of another size");
        });
      }
    }
  });
}

}  // namespace nadir::fuzz
