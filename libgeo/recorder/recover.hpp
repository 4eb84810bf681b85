// A finished MCAP file of what can be read of a damaged or unfinished one.
#pragma once

#include <filesystem>

#include "recorder/mcap_reader.hpp"

namespace nadir {

// Every message that is readable, with its schema and channel, its times and its number. Atomic: `target` appears when
// it is whole. Returns what was in the source; attachments and metadata are counted there but not carried over.
McapContents recover_mcap(const std::filesystem::path& source, const std::filesystem::path& target);

}  // namespace nadir
