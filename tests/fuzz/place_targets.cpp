// The table of a place index: what index/places.json may hold.
#include <nlohmann/json.hpp>

#include "base/json.hpp"
#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"
#include "vision/place_index_files.hpp"

namespace nadir::fuzz {
namespace {

// A sound table holds 264 kB of coefficients, which no fuzzer gets right by chance, and no corpus should have to keep:
// "basis":"*" and "mean":"*" stand for as many zeros as there have to be. What is no JSON at all throws before that.
std::string filled_in(std::string text) {
  const bool marked = text.find("\"*\"") != std::string::npos;
  if (marked) static_cast<void>(parse_json(text, "fuzz", {.max_depth = 4, .allow_floats = false}));
  const auto fill = [&](std::string_view mark, std::size_t numbers) {
    const std::size_t at = text.find(mark);
    if (at != std::string::npos)
      text.replace(at + mark.size() - 2, 1, std::string(numbers * sizeof(float) / 3 * 4, 'A'));
  };
  fill(R"("basis":"*")", kRawPlaceSize * kPlaceSize);
  fill(R"("mean":"*")", kRawPlaceSize);
  return text;
}

}  // namespace

void place_table(std::string_view bytes) {
  refusing([&] {
    const PlaceTable first = parse_place_table(filled_in(std::string(bytes)), "fuzz");
    std::size_t chunks = 0;
    for (const PlaceLayer& layer : first.layers) chunks += layer.count;
    require(chunks == first.chunks.size(), "layers that do not hold the chunks");
    const std::string written = place_table_json(first);
    require(place_table_json(parse_place_table(written, "again")) == written, "a table changes when it is written");
  });
}

}  // namespace nadir::fuzz
