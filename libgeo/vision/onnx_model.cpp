#include "vision/onnx_model.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <optional>
#include <set>

#include "base/error.hpp"
#include "base/printable.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

// Numbers of fields in onnx.proto.
namespace model_field {
constexpr std::uint32_t kFormat = 1, kProducer = 2, kGraph = 7, kOperators = 8;
}
namespace operators_field {
constexpr std::uint32_t kDomain = 1, kVersion = 2;
}
namespace graph_field {
constexpr std::uint32_t kNode = 1, kConstant = 5, kInput = 11, kOutput = 12;
}
namespace constant_field {
constexpr std::uint32_t kName = 8, kLocation = 14;
}
namespace value_field {
constexpr std::uint32_t kName = 1, kType = 2;
}
namespace type_field {
constexpr std::uint32_t kTensor = 1;
}
namespace tensor_field {
constexpr std::uint32_t kElement = 1, kShape = 2;
}
namespace shape_field {
constexpr std::uint32_t kSide = 1, kValue = 1;
}
constexpr std::uint64_t kElsewhere = 1;  // TensorProto.EXTERNAL

[[noreturn]] void reject(std::string_view file, const std::string& found) {
  throw Error({.what = "not a network that can be read",
               .where = std::string(file),
               .expected = "an ONNX model, whole and in one file",
               .found = found,
               .fix = "export the network again, with its weights inside"});
}

struct Field {
  std::uint32_t number = 0;
  std::uint64_t value = 0;  // of a number
  ByteView bytes;           // of a text, a message or packed numbers
};

// The fields of one message in their order.
class Message {
 public:
  Message(ByteView bytes, std::string_view file) : rest_(bytes), file_(file) {}

  std::optional<Field> next() {
    if (rest_.empty()) return std::nullopt;
    Field field;
    const std::uint64_t key = varint();
    if (key >> 32U != 0 || key >> 3U == 0) reject(file_, "a field without a number");
    field.number = static_cast<std::uint32_t>(key >> 3U);
    switch (key & 7U) {
      case 0: field.value = varint(); break;
      case 1: field.bytes = take(8); break;
      case 2: field.bytes = take(varint()); break;
      case 5: field.bytes = take(4); break;
      default: reject(file_, fmt::format("a field of type {}", key & 7U));
    }
    return field;
  }

 private:
  std::uint64_t varint() {
    std::uint64_t value = 0;
    for (unsigned shift = 0; shift < 64; shift += 7) {
      if (rest_.empty()) reject(file_, "the file ends within a number");
      const std::uint8_t byte = rest_.front();
      rest_ = rest_.subspan(1);
      value |= static_cast<std::uint64_t>(byte & 0x7fU) << shift;
      if ((byte & 0x80U) == 0) return value;
    }
    reject(file_, "a number of more than 64 bits");
  }

  ByteView take(std::uint64_t size) {
    if (size > rest_.size()) reject(file_, fmt::format("{} bytes where {} are left", size, rest_.size()));
    const ByteView taken = rest_.first(static_cast<std::size_t>(size));
    rest_ = rest_.subspan(taken.size());
    return taken;
  }

  ByteView rest_;
  std::string_view file_;
};

std::vector<std::int64_t> shape_of(ByteView bytes, std::string_view file) {
  std::vector<std::int64_t> shape;
  Message message(bytes, file);
  while (const auto side = message.next()) {
    if (side->number != shape_field::kSide) continue;
    if (shape.size() == parameters::learned_matching::kMaxTensorSides) reject(file, "a tensor of too many dimensions");
    shape.push_back(OnnxTensor::kOpen);
    Message inside(side->bytes, file);
    while (const auto field = inside.next()) {
      if (field->number == shape_field::kValue) shape.back() = static_cast<std::int64_t>(field->value);
    }
  }
  return shape;
}

OnnxTensor tensor_of(ByteView bytes, std::string_view file) {
  OnnxTensor tensor;
  Message value(bytes, file);
  while (const auto field = value.next()) {
    if (field->number == value_field::kName) tensor.name = as_text(field->bytes);
    if (field->number != value_field::kType) continue;
    Message type(field->bytes, file);
    while (const auto kind = type.next()) {
      if (kind->number != type_field::kTensor) continue;
      Message inside(kind->bytes, file);
      while (const auto part = inside.next()) {
        if (part->number == tensor_field::kElement) tensor.element_type = static_cast<std::int64_t>(part->value);
        if (part->number == tensor_field::kShape) tensor.shape = shape_of(part->bytes, file);
      }
    }
  }
  return tensor;
}

// The name of a constant.
std::string constant_of(ByteView bytes, std::string_view file) {
  std::string name;
  Message constant(bytes, file);
  while (const auto field = constant.next()) {
    if (field->number == constant_field::kName) name = as_text(field->bytes);
    if (field->number == constant_field::kLocation && field->value == kElsewhere) {
      reject(file, "weights in another file, which no digest covers");
    }
  }
  return name;
}

void read_graph(ByteView bytes, std::string_view file, OnnxModel& model) {
  std::set<std::string> constants;
  Message graph(bytes, file);
  const auto add = [&](std::vector<OnnxTensor>& tensors, ByteView value) {
    if (tensors.size() == parameters::learned_matching::kMaxTensors) reject(file, "too many inputs or outputs");
    tensors.push_back(tensor_of(value, file));
  };
  // Older formats list the constants among the inputs, and before their values: they are sorted out at the end.
  std::vector<OnnxTensor> inputs;
  while (const auto field = graph.next()) {
    switch (field->number) {
      case graph_field::kNode: ++model.nodes; break;
      case graph_field::kConstant: constants.insert(constant_of(field->bytes, file)); break;
      case graph_field::kInput: inputs.push_back(tensor_of(field->bytes, file)); break;
      case graph_field::kOutput: add(model.outputs, field->bytes); break;
      default: break;
    }
  }
  for (OnnxTensor& input : inputs) {
    if (constants.contains(input.name)) continue;
    if (model.inputs.size() == parameters::learned_matching::kMaxTensors) reject(file, "too many inputs or outputs");
    model.inputs.push_back(std::move(input));
  }
}

std::string text_of(const OnnxTensor& tensor) {
  std::vector<std::string> sides;
  for (const std::int64_t side : tensor.shape) {
    sides.push_back(side == OnnxTensor::kOpen ? "any" : std::to_string(side));
  }
  return fmt::format("{} ({}{})", printable(tensor.name), fmt::join(sides, " x "),
                     tensor.element_type == OnnxTensor::kFloat ? "" : ", no floats");
}

std::string text_of(const std::vector<OnnxTensor>& tensors) {
  std::vector<std::string> texts;
  for (const OnnxTensor& tensor : tensors) texts.push_back(text_of(tensor));
  return texts.empty() ? "none" : fmt::format("{}", fmt::join(texts, ", "));
}

// Pictures by channels, rows and columns, of floats, of any size.
bool is_picture(const OnnxTensor& tensor) {
  return tensor.element_type == OnnxTensor::kFloat && tensor.shape.size() == 4 && tensor.shape[0] <= 1 &&
         tensor.shape[2] == OnnxTensor::kOpen && tensor.shape[3] == OnnxTensor::kOpen;
}

}  // namespace

OnnxModel read_onnx_model(ByteView bytes, std::string_view file) {
  OnnxModel model;
  bool graph = false;
  Message message(bytes, file);
  while (const auto field = message.next()) {
    switch (field->number) {
      case model_field::kFormat: model.format = static_cast<std::int64_t>(field->value); break;
      case model_field::kProducer: model.producer = as_text(field->bytes); break;
      case model_field::kGraph:
        if (graph) reject(file, "two graphs");
        graph = true;
        read_graph(field->bytes, file, model);
        break;
      case model_field::kOperators: {
        std::string domain;
        std::int64_t version = 0;
        Message set(field->bytes, file);
        while (const auto part = set.next()) {
          if (part->number == operators_field::kDomain) domain = as_text(part->bytes);
          if (part->number == operators_field::kVersion) version = static_cast<std::int64_t>(part->value);
        }
        if (domain.empty() || domain == "ai.onnx") model.operators = version;
        break;
      }
      default: break;
    }
  }
  if (!graph || model.format <= 0) reject(file, bytes.empty() ? "an empty file" : "no graph of a network");
  return model;
}

DescriptorModel descriptor_model(const OnnxModel& model, std::string_view file) {
  using namespace parameters::learned_matching;
  const auto wrong = [&](const std::string& expected, const std::string& found) {
    return Error({.what = "the network is no dense descriptor network",
                  .where = std::string(file),
                  .expected = expected,
                  .found = found,
                  .fix = "use another model (docs/second-matcher.md says what it must be)"});
  };
  if (model.inputs.size() != 1 || !is_picture(model.inputs[0]) ||
      (model.inputs[0].shape[1] != 1 && model.inputs[0].shape[1] != 3)) {
    throw wrong("one input of floats: 1 x 1 or 3 channels x any height x any width", text_of(model.inputs));
  }
  const auto named = std::find_if(model.outputs.begin(), model.outputs.end(),
                                  [](const OnnxTensor& output) { return output.name == "descriptors"; });
  if (named == model.outputs.end() && model.outputs.size() != 1) {
    throw wrong("one output, or one that is named descriptors", text_of(model.outputs));
  }
  const OnnxTensor& output = named != model.outputs.end() ? *named : model.outputs.front();
  const bool fits =
      is_picture(output) && output.shape[1] >= kMinDescriptorChannels && output.shape[1] <= kMaxDescriptorChannels;
  if (!fits) {
    throw wrong(fmt::format("descriptors as floats: 1 x {} to {} channels x rows x columns", kMinDescriptorChannels,
                            kMaxDescriptorChannels),
                text_of(output));
  }
  return {model.inputs[0].name, static_cast<int>(model.inputs[0].shape[1]), output.name,
          static_cast<int>(output.shape[1])};
}

}  // namespace nadir
