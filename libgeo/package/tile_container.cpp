#include "package/tile_container.hpp"

#include <array>
#include <fstream>

#include "package/cog_container.hpp"
#include "package/mbtiles_container.hpp"

namespace nadir {
namespace {

bool begins_as_tiff(const std::filesystem::path& path) {
  if (!std::filesystem::is_regular_file(path)) return false;
  std::array<char, 4> head{};
  std::ifstream file(path, std::ios::binary);
  file.read(head.data(), head.size());
  const std::string_view magic(head.data(), static_cast<std::size_t>(file.gcount()));
  return magic == std::string_view("II*\0", 4) || magic == std::string_view("MM\0*", 4) ||
         magic == std::string_view("II+\0", 4) || magic == std::string_view("MM\0+", 4) ||
         (path.extension() == ".tif" && !magic.starts_with("SQLi"));
}

}  // namespace

std::unique_ptr<TileContainer> open_tile_container(const std::filesystem::path& path) {
  return begins_as_tiff(path) ? open_cog_container(path) : open_mbtiles_container(path);
}

std::unique_ptr<TileSource> open_tile_source(const std::filesystem::path& path) {
  if (begins_as_tiff(path)) return std::make_unique<CogReader>(path);
  return std::make_unique<MbtilesReader>(path);
}

Finding fault_of(const Error& error, std::string where) {
  const ErrorText& text = error.text();
  if (const auto* cog = dynamic_cast<const TiffError*>(&error)) {
    return {.code = cog->code(),
            .where = std::move(where),
            .expected = text.expected,
            .found = text.found.empty() ? text.what : text.found,
            .fix = text.fix};
  }
  return {.code = "sqlite.corrupt",
          .where = std::move(where),
          .expected = "a sound SQLite database",
          .found = text.found.empty() ? text.what : text.found,
          .fix = "make the file again; a copy of a damaged file stays damaged"};
}

}  // namespace nadir
