// Records as FlatBuffers and back, bit for bit.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "recorder/records.hpp"

namespace nadir {

Bytes encode(const Record& record);

// nullopt for bytes that are not a valid record of this topic: they are verified before they are read.
std::optional<Record> decode(Topic topic, ByteView bytes);

// Keys never enter a recording, whatever the settings contain: the value, or "[withheld]" for one whose name contains
// key, signature, passphrase, password, secret or token, or that contains a private key.
std::string redacted_setting(std::string_view name, std::string_view value);

}  // namespace nadir
