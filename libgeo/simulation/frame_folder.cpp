#include "simulation/frame_folder.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <fstream>

#include "base/error.hpp"

namespace nadir {
namespace {

[[noreturn]] void fail(const std::filesystem::path& path, const std::error_code& error) {
  throw Error({.what = "the picture cannot be written",
               .where = path.string(),
               .expected = "a folder with room that may be written to",
               .found = error.message(),
               .fix = "make room, or choose another --out; --keep N keeps the folder small"});
}

std::error_code last_error() { return {errno, std::generic_category()}; }

}  // namespace

FrameFolder::FrameFolder(std::filesystem::path folder, std::optional<int> keep)
    : folder_(std::move(folder)), keep_(keep) {
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  if (error || !std::filesystem::is_directory(folder_)) {
    throw Error({.what = "the folder cannot be made",
                 .where = folder_.string(),
                 .found = error ? error.message() : "something else of this name",
                 .fix = "choose another --out"});
  }
}

void FrameFolder::put(ByteView jpeg, std::int64_t unix_us) {
  const std::string name = fmt::format("frame_{:016}.jpg", std::max<std::int64_t>(0, unix_us));
  const std::filesystem::path path = folder_ / name, temporary = folder_ / ("." + name + ".tmp");
  // Not brought to disk, unlike results: a picture is wanted for seconds, and waiting for the disk would cost frames.
  std::ofstream file(temporary, std::ios::binary | std::ios::trunc);
  file.write(reinterpret_cast<const char*>(jpeg.data()), static_cast<std::streamsize>(jpeg.size()));
  file.close();
  std::error_code ignored;
  if (!file) {
    const std::error_code error = last_error();
    std::filesystem::remove(temporary, ignored);
    fail(path, error);
  }
  std::error_code error;
  std::filesystem::rename(temporary, path, error);
  if (error) {
    std::filesystem::remove(temporary, ignored);
    fail(path, error);
  }
  if (!keep_) return;
  // A clock that was set back may give a name twice: it counts once, as the youngest.
  std::erase(written_, path);
  written_.push_back(path);
  while (std::ssize(written_) > *keep_) {
    std::filesystem::remove(written_.front(), ignored);  // whoever reads it may have removed it already
    written_.pop_front();
  }
}

}  // namespace nadir
