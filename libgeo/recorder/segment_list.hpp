// The segments of a folder: NNNNNN.flight.mcap, NNNNNN.pictures.mcap, NNNNNN.thumbnails.mcap. Numbers grow in the order
// in which the files were made, through restarts; they do not depend on the clock.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "recorder/topics.hpp"

namespace nadir {

struct Segment {
  std::filesystem::path path;
  std::uint32_t number = 0;
  Stream stream = Stream::flight;
  std::uint64_t bytes = 0;
};

std::filesystem::path segment_path(const std::filesystem::path& folder, std::uint32_t number, Stream stream);

// By number. Other files are left out. Throws Error when the folder cannot be read.
std::vector<Segment> segments_in(const std::filesystem::path& folder);

// The one to delete when there is too much: thumbnails before pictures before decisions, the oldest first.
// up_to: streams beyond this one are spared. End of the list: none.
std::vector<Segment>::const_iterator most_expendable(const std::vector<Segment>& segments, Stream up_to);

}  // namespace nadir
