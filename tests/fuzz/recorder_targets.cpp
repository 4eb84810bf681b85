// MCAP files and the flight recorder's payloads in them.
#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"
#include "recorder/mcap_reader.hpp"
#include "recorder/record_codec.hpp"

namespace nadir::fuzz {

void mcap(std::string_view bytes) {
  std::uint64_t messages = 0;
  const auto take = [&](const McapContents& contents, const McapMessage& message) {
    ++messages;
    const auto topic = parse_topic(contents.channels.at(message.channel_id).topic);
    if (!topic) return;
    const auto record = decode(*topic, message.data);
    if (!record) return;
    const Bytes written = encode(*record);
    const auto again = decode(*topic, written);
    require(again && encode(*again) == written, "a record changes when it is written");
  };
  const McapContents contents = read_mcap(MemorySource(as_bytes(bytes)), "fuzz", take);
  require(contents.messages == messages, "messages are not counted");
  require(contents.whole_size <= contents.size, "more was read than there is");
}

}  // namespace nadir::fuzz
