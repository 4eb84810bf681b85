// What a flight reads: the autopilot's stream, recordings, the table of a place index.
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "base/json.hpp"
#include "fixes/fix_stream.hpp"
#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"
#include "mavlink/messages.hpp"
#include "recorder/mcap_reader.hpp"
#include "recorder/record_codec.hpp"
#include "vision/localizer_parameters.hpp"
#include "vision/onnx_model.hpp"
#include "vision/place_index_files.hpp"

namespace nadir::fuzz {

// What arrives over the autopilot's link: bytes into frames, frames into messages.

namespace {

std::vector<Bytes> frames_of(ByteView bytes, std::size_t piece) {
  FrameReader reader;
  std::vector<Bytes> frames;
  const auto drain = [&] {
    while (const auto frame = reader.next()) {
      static_cast<void>(decode(*frame));
      frames.push_back(frame->bytes);
    }
  };
  for (std::size_t at = 0; at < bytes.size(); at += piece) {
    reader.add(bytes.subspan(at, std::min(piece, bytes.size() - at)));
    drain();
  }
  reader.finish();
  drain();
  std::size_t used = 0;
  for (const Bytes& frame : frames) used += frame.size();
  require(used + reader.counts().skipped_bytes == bytes.size(), "bytes that are neither frames nor skipped");
  require(frames.size() == reader.counts().frames, "frames that are not counted");
  return frames;
}

}  // namespace

void mavlink(std::string_view bytes) {
  const std::vector<Bytes> frames = frames_of(as_bytes(bytes), bytes.size() + 1);
  frames_of(as_bytes(bytes), 1);
  // What is valid alone is valid in a sequence.
  Bytes joined;
  for (const Bytes& frame : frames) joined.insert(joined.end(), frame.begin(), frame.end());
  require(frames_of(joined, joined.size() + 1) == frames, "sound frames are not found again");
}

// MCAP files and the flight recorder's payloads in them; and the fixes that follow from what is in there.

namespace {

void make_fix(FixStream& stream, const FixInputRecord& inputs) {
  for (const FixInputRecord::Input& input : inputs.inputs) {
    if (const auto* attitude = std::get_if<FixInputRecord::Attitude>(&input.what)) {
      stream.on_input(input.time_us, *attitude);
    } else if (const auto* force = std::get_if<FixInputRecord::Acceleration>(&input.what)) {
      stream.on_input(input.time_us, *force);
    } else {
      const VisionEstimate estimate{.time_us = input.time_us - 100'000,
                                    .place = {8.5, 47.4},
                                    .sigma_m = std::abs(inputs.status.sigma_m),
                                    .east_mps = 20};
      stream.on_input(input.time_us, std::get<FixInputRecord::ArrivedEstimate>(input.what), estimate);
    }
  }
  const auto due = stream.turn(inputs.time_us, inputs.unix_us, inputs.status);
  if (due) require(decode(Topic::fix, encode(Record(fix_record(*due)))).has_value(), "a fix that cannot be recorded");
}

}  // namespace

void mcap(std::string_view bytes) {
  std::uint64_t messages = 0;
  FixStream stream;
  const auto take = [&](const McapContents& contents, const McapMessage& message) {
    ++messages;
    const auto topic = parse_topic(contents.channels.at(message.channel_id).topic);
    if (!topic) return;
    const auto record = decode(*topic, message.data);
    if (!record) return;
    const Bytes written = encode(*record);
    const auto again = decode(*topic, written);
    require(again && encode(*again) == written, "a record changes when it is written");
    if (const auto* inputs = std::get_if<FixInputRecord>(&*record)) make_fix(stream, *inputs);
  };
  const McapContents contents = read_mcap(MemorySource(as_bytes(bytes)), "fuzz", take);
  require(contents.messages == messages, "messages are not counted");
  require(contents.whole_size <= contents.size, "more was read than there is");
}

// The table of a place index: what index/places.json may hold.

namespace {

// A valid table holds 264 kB of coefficients, which no fuzzer gets right by chance and no corpus should store:
// "basis":"*" and "mean":"*" stand for the required number of zeros. Invalid JSON throws before that.
std::string filled_in(std::string text) {
  const bool marked = text.find("\"*\"") != std::string::npos;
  if (marked) static_cast<void>(parse_json(text, "fuzz", {.max_depth = 4, .allow_floats = false}));
  const auto fill = [&](std::string_view mark, std::size_t numbers) {
    const std::size_t at = text.find(mark);
    if (at != std::string::npos)
      text.replace(at + mark.size() - 2, 1, std::string(numbers * sizeof(float) / 3 * 4, 'A'));
  };
  fill(R"("basis":"*")", kRawPlaceSize * kPlaceSize);
  fill(R"("mean":"*")", kRawPlaceSize);
  return text;
}

}  // namespace

void place_table(std::string_view bytes) {
  refusing([&] {
    const PlaceTable first = parse_place_table(filled_in(std::string(bytes)), "fuzz");
    std::size_t chunks = 0;
    for (const PlaceLayer& layer : first.layers) chunks += layer.count;
    require(chunks == first.chunks.size(), "layers that do not hold the chunks");
    const std::string written = place_table_json(first);
    require(place_table_json(parse_place_table(written, "again")) == written, "a table changes when it is written");
  });
}

void onnx(std::string_view bytes) {
  refusing([&] {
    const OnnxModel model = read_onnx_model(as_bytes(bytes), "fuzz");
    require(model.format > 0, "a model without a format");
    for (const auto* tensors : {&model.inputs, &model.outputs}) {
      require(tensors->size() <= parameters::learned_matching::kMaxTensors, "more tensors than there may be");
      for (const OnnxTensor& tensor : *tensors) {
        require(tensor.shape.size() <= parameters::learned_matching::kMaxTensorSides, "more sides than there may be");
      }
    }
    const DescriptorModel descriptors = descriptor_model(model, "fuzz");
    require(descriptors.input_channels == 1 || descriptors.input_channels == 3, "a picture of other channels");
    require(descriptors.channels >= parameters::learned_matching::kMinDescriptorChannels &&
                descriptors.channels <= parameters::learned_matching::kMaxDescriptorChannels,
            "descriptors of a length that is not allowed");
  });
}

}  // namespace nadir::fuzz
