// What an ONNX file says of itself: the tensors that go in and out, without any inference library. A model is checked
// so before one sees it, and on machines that have none.
//
// The file is a protocol buffer (onnx.proto, https://onnx.ai): ModelProto with the version of the format, the sets of
// operators and a graph, whose inputs and outputs have a name, an element type and a shape. Everything else is skipped.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"

namespace nadir {

struct OnnxTensor {
  static constexpr std::int64_t kOpen = -1;  // a side that is known only when the network runs
  static constexpr std::int64_t kFloat = 1;  // element type: 32 bit floats

  std::string name;
  std::int64_t element_type = 0;  // TensorProto.DataType; 0: not a tensor
  std::vector<std::int64_t> shape;
};

struct OnnxModel {
  std::int64_t format = 0;     // ir_version
  std::int64_t operators = 0;  // version of the standard set
  std::string producer;
  std::size_t nodes = 0;
  std::vector<OnnxTensor> inputs;  // constants not among them
  std::vector<OnnxTensor> outputs;
};

// file: its name, for messages. Throws Error for bytes that are no such model, and for one whose constants are in other
// files, which the model's digest would not cover.
OnnxModel read_onnx_model(ByteView bytes, std::string_view file);

// A model as a dense descriptor network (dense_descriptors.hpp) needs it.
struct DescriptorModel {
  std::string input;        // 1 or 3 channels of any height and width, values 0 to 1
  int input_channels = 0;   // 3: the grey image three times
  std::string descriptors;  // named so, or the only output
  int channels = 0;         // of a descriptor
};

// Throws Error that says what the model has instead.
DescriptorModel descriptor_model(const OnnxModel& model, std::string_view file);

}  // namespace nadir
