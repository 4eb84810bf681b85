// ONNX models of one convolution, written by hand: small enough to know what they give.
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <vector>

namespace nadir::test {

// A message of a protocol buffer.
class ProtoMessage {
 public:
  ProtoMessage& number(std::uint32_t field, std::uint64_t value) {
    varint(std::uint64_t{field} << 3U);
    varint(value);
    return *this;
  }
  ProtoMessage& text(std::uint32_t field, std::string_view value) {
    varint((std::uint64_t{field} << 3U) | 2U);
    varint(value.size());
    bytes_ += value;
    return *this;
  }
  ProtoMessage& message(std::uint32_t field, const ProtoMessage& inside) { return text(field, inside.bytes_); }
  const std::string& bytes() const { return bytes_; }

 private:
  void varint(std::uint64_t value) {
    for (; value >= 128; value >>= 7U) bytes_ += static_cast<char>(value | 128U);
    bytes_ += static_cast<char>(value);
  }
  std::string bytes_;
};

struct TinyModel {
  std::string input = "input", output = "descriptors";
  int input_channels = 1;
  std::vector<std::int64_t> input_sides = {-1, -1};  // height, width; -1: any
  int channels = 8;                                  // of the output
  int stride = 8;
  std::uint64_t element_type = 1;  // float
  bool external_weights = false;
  float factor = 1;  // of all weights
};

// |convolution by 8 x 8 with `stride`|: the strength of edges and waves of a few directions and widths in each cell.
inline std::string onnx_model(const TinyModel& tiny = {}) {
  const auto shape = [](const std::vector<std::int64_t>& sides) {
    ProtoMessage all;
    for (const std::int64_t side : sides) {
      ProtoMessage one;
      side < 0 ? one.text(2, "any") : one.number(1, static_cast<std::uint64_t>(side));
      all.message(1, one);
    }
    return all;
  };
  const auto value = [&](const std::string& name, const std::vector<std::int64_t>& sides) {
    ProtoMessage tensor, type, info;
    tensor.number(1, tiny.element_type).message(2, shape(sides));
    type.message(1, tensor);
    return info.text(1, name).message(2, type);
  };
  const auto ints = [](const std::string& name, const std::vector<std::uint64_t>& values) {
    ProtoMessage attribute;
    attribute.text(1, name).number(20, 7);
    for (const std::uint64_t v : values) attribute.number(8, v);
    return attribute;
  };
  std::string weights;
  for (int k = 0; k < tiny.channels; ++k) {
    for (int i = 0; i < tiny.input_channels; ++i) {
      for (int r = 0; r < 8; ++r) {
        for (int c = 0; c < 8; ++c) {
          // Directions by k, widths by k / 4: +1 and -1 on both sides of lines through the middle.
          const int across = k % 4 == 0 ? 2 * c - 7 : k % 4 == 1 ? 2 * r - 7 : k % 4 == 2 ? r + c - 7 : r - c;
          const int width = 8 >> (k / 4 % 3);
          const float weight = tiny.factor * (((across + 16) / width) % 2 == 0 ? 1.0F : -1.0F);
          const auto bits = std::bit_cast<std::uint32_t>(weight);
          for (unsigned shift = 0; shift < 32; shift += 8) weights += static_cast<char>((bits >> shift) & 255U);
        }
      }
    }
  }
  ProtoMessage constant;
  for (const int side : {tiny.channels, tiny.input_channels, 8, 8})
    constant.number(1, static_cast<std::uint64_t>(side));
  constant.number(2, 1).text(8, "weights");
  tiny.external_weights ? constant.number(14, 1) : constant.text(9, weights);
  ProtoMessage convolution, absolute, graph, operators, model;
  const auto stride = static_cast<std::uint64_t>(tiny.stride);
  convolution.text(1, tiny.input).text(1, "weights").text(2, "sums").text(4, "Conv");
  convolution.message(5, ints("kernel_shape", {8, 8})).message(5, ints("strides", {stride, stride}));
  absolute.text(1, "sums").text(2, tiny.output).text(4, "Abs");
  graph.message(1, convolution).message(1, absolute).text(2, "tiny").message(5, constant);
  graph.message(11, value(tiny.input, {1, tiny.input_channels, tiny.input_sides[0], tiny.input_sides[1]}));
  graph.message(12, value(tiny.output, {1, tiny.channels, -1, -1}));
  operators.text(1, "").number(2, 13);
  return model.number(1, 8).text(2, "nadir tests").message(7, graph).message(8, operators).bytes();
}

}  // namespace nadir::test
