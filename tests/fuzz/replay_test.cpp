// The corpus with every compiler: unchanged, truncated everywhere, and with every bit flipped. Whatever fuzzing finds
// is added to the corpus as a regression test. Files in a folder TARGET/reached were found by libFuzzer to cover the
// reader's code, or are one case among many: replayed unchanged.
#include <gtest/gtest.h>

#include <ostream>
#include <string_view>
#include <vector>

#include "base/files.hpp"
#include "fuzz/targets.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

struct Target {
  const char* name;  // also the folder of its corpus
  void (*run)(std::string_view);
};
void PrintTo(const Target& target, std::ostream* out) { *out << target.name; }  // in the names of tests

const std::vector<Target>& targets() {
  static const std::vector<Target> all{{"root", fuzz::root},
                                       {"envelope", fuzz::envelope},
                                       {"manifest", fuzz::manifest},
                                       {"mission", fuzz::mission},
                                       {"state", fuzz::state},
                                       {"permit", fuzz::permit},
                                       {"time_permit", fuzz::time_permit},
                                       {"patch", fuzz::patch},
                                       {"file_delta", fuzz::file_delta},
                                       {"acceptance", fuzz::acceptance},
                                       {"candidate", fuzz::candidate},
                                       {"candidate_rows", fuzz::candidate_rows},
                                       {"terrain", fuzz::terrain},
                                       {"matchability", fuzz::matchability},
                                       {"vectors", fuzz::vectors},
                                       {"vrt", fuzz::vrt},
                                       {"tile_package", fuzz::tile_package},
                                       {"numpy_array", fuzz::numpy_array},
                                       {"stac_item", fuzz::stac_item},
                                       {"stac_list", fuzz::stac_list},
                                       {"tiled_assets", fuzz::tiled_assets},
                                       {"kml", fuzz::kml},
                                       {"geojson", fuzz::geojson},
                                       {"plan", fuzz::plan},
                                       {"waypoints", fuzz::waypoints},
                                       {"camera", fuzz::camera},
                                       {"telemetry", fuzz::telemetry},
                                       {"inertial", fuzz::inertial},
                                       {"poses", fuzz::poses},
                                       {"picture", fuzz::picture},
                                       {"shard_plan", fuzz::shard_plan},
                                       {"metatile", fuzz::metatile},
                                       {"shard_result", fuzz::shard_result},
                                       {"mbtiles", fuzz::mbtiles},
                                       {"tile_rows", fuzz::tile_rows},
                                       {"cog", fuzz::cog},
                                       {"pmtiles", fuzz::pmtiles},
                                       {"place_table", fuzz::place_table},
                                       {"onnx", fuzz::onnx},
                                       {"api_hint", fuzz::api_hint},
                                       {"api_object", fuzz::api_object},
                                       {"api_playback", fuzz::api_playback},
                                       {"api_request", fuzz::api_request},
                                       {"multipart", fuzz::multipart},
                                       {"batch", fuzz::batch},
                                       {"pack", fuzz::pack},
                                       {"upload_request", fuzz::upload_request},
                                       {"reply", fuzz::reply},
                                       {"installed", fuzz::installed},
                                       {"tokens", fuzz::tokens},
                                       {"audit", fuzz::audit},
                                       {"http_date", fuzz::http_date},
                                       {"outbox", fuzz::outbox},
                                       {"outbox_rows", fuzz::outbox_rows},
                                       {"dataflash", fuzz::dataflash},
                                       {"ulog", fuzz::ulog},
                                       {"tlog", fuzz::tlog},
                                       {"photo_metadata", fuzz::photo_metadata},
                                       {"answers", fuzz::answers},
                                       {"flight_rows", fuzz::flight_rows},
                                       {"flight_file", fuzz::flight_file},
                                       {"mavlink", fuzz::mavlink},
                                       {"mcap", fuzz::mcap}};
  return all;
}

class Fuzz : public ::testing::TestWithParam<Target> {
 protected:
  static std::vector<fs::path> files_in(const fs::path& folder) {
    std::vector<fs::path> files;
    if (!fs::is_directory(folder)) return files;
    for (const auto& entry : fs::directory_iterator(folder)) {
      if (entry.is_regular_file()) files.push_back(entry.path());
    }
    return files;
  }
  static fs::path folder() { return fs::path(NADIR_FUZZ_CORPUS) / GetParam().name; }
  static std::vector<fs::path> corpus() { return files_in(folder()); }
  static std::vector<fs::path> reached() { return files_in(folder() / "reached"); }
};

TEST_P(Fuzz, ReplaysTheCorpus) {
  ASSERT_GE(corpus().size(), 3U);
  for (const fs::path& file : corpus()) {
    SCOPED_TRACE(file);
    GetParam().run(read_text_file(file));
  }
  for (const fs::path& file : reached()) {
    SCOPED_TRACE(file);
    GetParam().run(read_text_file(file));
  }
}

TEST_P(Fuzz, WithstandsTruncationAndBitFlips) {
  for (const fs::path& file : corpus()) {
    SCOPED_TRACE(file);
    const std::string whole = read_text_file(file);
    const std::size_t step = 1 + whole.size() / 200;
    for (std::size_t at = 0; at < whole.size(); at += step) {
      GetParam().run(std::string_view(whole).substr(0, at));
      std::string flipped = whole;
      flipped[at] = static_cast<char>(flipped[at] ^ (1 << (at / step % 7)));
      GetParam().run(flipped);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, Fuzz, ::testing::ValuesIn(targets()),
                         [](const auto& target) { return std::string(target.param.name); });

}  // namespace
}  // namespace nadir
