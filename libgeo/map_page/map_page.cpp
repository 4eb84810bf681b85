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
  if (tiles == nullptr) return answer({.status = 404, .type = "tile", .detail = "there is no package"});
  const std::optional<Bytes> bytes = tiles->read(*key);
  if (!bytes) return {.status = 204, .content_type = {}, .headers = {{"Cache-Control", "private, max-age=60"}}};
  const std::optional<ImageFormat> format = sniff_image_format(*bytes);
  if (!format) return answer({.status = 404, .type = "tile", .detail = "the package holds no image there"});
  return {.content_type = fmt::format("image/{}", name_of(*format)),
          .body = std::string(as_text(*bytes)),
          .headers = {{"Cache-Control", "private, max-age=60"}}};
}

ApiResponse vectors_answer(std::optional<Bytes> vectors) {
  if (!vectors) return {.status = 204, .content_type = {}, .headers = {{"Cache-Control", "no-store"}}};
  return {.content_type = "application/geo+json",
          .body = std::string(as_text(*vectors)),
          .headers = {{"Cache-Control", "no-store"}}};
}

}  // namespace nadir
