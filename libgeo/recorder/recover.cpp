#include "recorder/recover.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include "base/error.hpp"
#include "recorder/mcap_writer.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kChunkBytes = std::size_t{1} << 20;

void require(bool written, const SegmentFile& file) {
  if (written) return;
  const ErrorText text{.what = "cannot write", .where = file.path(), .found = system_error_text(file.error())};
  throw Error(text);
}

}  // namespace

McapContents recover_mcap(const fs::path& source, const fs::path& target) {
  const FileSource bytes(source);
  if (fs::exists(target))
    throw Error({.what = "the file is there already", .where = target, .fix = "give another name"});
  const fs::path staging = target.parent_path() / fmt::format(".{}.{}.staging", target.filename().string(), ::getpid());
  McapContents contents;
  try {
    SegmentFile file(staging, false);
    require(file.ok(), file);
    McapWriter writer(file, {.profile = "nadir", .library = "nadir recorder recover", .zstd_level = 1});
    contents = read_mcap(bytes, source.string(), [&](const McapContents& so_far, const McapMessage& message) {
      const McapChannel& channel = so_far.channels.at(message.channel_id);
      const auto schema = so_far.schemas.find(channel.schema_id);
      if (schema != so_far.schemas.end()) writer.add(schema->second);
      writer.add(channel);
      writer.write(message);
      if (writer.chunk_bytes() >= kChunkBytes) require(writer.flush(), file);
    });
    if (contents.messages != 0) {
      require(writer.finish(), file);
      require(file.sync(), file);
    }
  } catch (...) {
    std::error_code ignored;
    fs::remove(staging, ignored);
    throw;
  }
  if (contents.messages == 0) {
    fs::remove(staging);
  } else {
    fs::rename(staging, target);
  }
  return contents;
}

}  // namespace nadir
