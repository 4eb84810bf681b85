// One record of each kind with a value in every field, seeded.
#pragma once

#include <vector>

#include "base/random.hpp"
#include "recorder/mcap_reader.hpp"
#include "recorder/record_codec.hpp"

namespace nadir::test {

SessionRecord sample_session();
std::vector<Record> sample_records(Random& random);
InputRecord sample_input(std::uint64_t index);
EstimateRecord sample_estimate(std::uint64_t index);

// Equal in every bit that is recorded: both encode to the same bytes.
bool same(const Record& a, const Record& b);

struct ReadBack {
  McapContents contents;
  std::vector<std::pair<Topic, Record>> records;
  std::size_t undecodable = 0;

  std::vector<Record> of(Topic topic) const;
};

ReadBack read_back(const ByteSource& source);
ReadBack read_back(const std::filesystem::path& path);

}  // namespace nadir::test
