// pymavlink, an independent implementation, writes frames for us and reads ours (judge.py).
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/bytes.hpp"

namespace nadir::test {

std::string hex(ByteView bytes);
Bytes from_hex(std::string_view text);

// Frames of messages, each a line of JSON: {"message": "ATTITUDE", "roll": 0.5}. Options as judge.py takes them.
std::vector<Bytes> frames_by_pymavlink(const std::string& messages, const std::string& options = {});

// What pymavlink reads in each frame, or {"refused": reason}.
std::vector<nlohmann::json> read_by_pymavlink(const std::vector<Bytes>& frames, const std::string& options = {});

}  // namespace nadir::test
