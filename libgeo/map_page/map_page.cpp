#include "map_page/map_page.hpp"

#include <fmt/format.h>

#include "imagery/codecs.hpp"

namespace nadir {

ApiResponse tile_answer(const TileSource* tiles, std::string_view address) {
  const std::optional<TileKey> key = parse_tile_key(address);
  if (!key) {
    return answer({.status = 404,
                   .type = "tile",
                   .detail = "a tile's path ends in tiles/ZOOM/COLUMN/ROW, rows counted from the north"});
  }
  const std::optional<Bytes> bytes = tiles != nullptr ? tiles->read(*key) : std::nullopt;
  const std::optional<ImageFormat> format = bytes ? sniff_image_format(*bytes) : std::nullopt;
  if (!format) return answer({.status = 404, .type = "tile", .detail = "the package holds no such tile"});
  return {.content_type = fmt::format("image/{}", name_of(*format)),
          .body = std::string(as_text(*bytes)),
          .headers = {{"Cache-Control", "private, max-age=60"}}};
}

}  // namespace nadir
