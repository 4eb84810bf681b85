// The kinds of records as MCAP knows them: a topic, a schema, and the stream of segments that they go to.
#pragma once

#include <array>
#include <optional>
#include <string_view>

#include "recorder/mcap_format.hpp"
#include "recorder/records.hpp"

namespace nadir {

// In the order of Record's alternatives.
enum class Topic { session, input, picture, estimate, anchor, state, tile, health, thumbnail, recorder, end, hint };
inline constexpr std::size_t kTopics = 12;

inline Topic topic_of(const Record& record) { return static_cast<Topic>(record.index()); }

// What is bulky lies in files of its own, so that it can go first when room is short.
enum class Stream { flight, pictures, thumbnails };
inline constexpr std::array<Stream, 3> kStreams{Stream::flight, Stream::pictures, Stream::thumbnails};

std::string_view name_of(Stream stream);  // in file names
std::optional<Stream> parse_stream(std::string_view name);

std::string_view name_of(Topic topic);  // "/estimate"
std::optional<Topic> parse_topic(std::string_view name);
Stream stream_of(Topic topic);

std::string_view schema_name_of(Topic topic);  // "nadir.recorder.Estimate"

// As they stand in every file: channel and schema of a topic have the number topic + 1.
McapChannel mcap_channel(Topic topic);
McapSchema mcap_schema(Topic topic);

}  // namespace nadir
