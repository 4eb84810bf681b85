#include "vision/onnx_model.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/error.hpp"
#include "support/onnx_writer.hpp"

namespace nadir {
namespace {

using namespace test;
using testing::HasSubstr;

OnnxModel read_model(const std::string& bytes) { return read_onnx_model(as_bytes(bytes), "tiny.onnx"); }

std::string rejection(const std::string& bytes) {
  try {
    descriptor_model(read_model(bytes), "tiny.onnx");
    return "accepted";
  } catch (const Error& error) {
    return error.what();
  }
}

TEST(OnnxModel, NamesItsTensors) {
  const OnnxModel model = read_model(onnx_model());
  EXPECT_EQ(model.format, 8);
  EXPECT_EQ(model.operators, 13);
  EXPECT_EQ(model.producer, "nadir tests");
  EXPECT_EQ(model.nodes, 2U);
  ASSERT_EQ(model.inputs.size(), 1U);
  EXPECT_EQ(model.inputs[0].name, "input");
  EXPECT_EQ(model.inputs[0].element_type, OnnxTensor::kFloat);
  EXPECT_EQ(model.inputs[0].shape, (std::vector<std::int64_t>{1, 1, OnnxTensor::kOpen, OnnxTensor::kOpen}));
  ASSERT_EQ(model.outputs.size(), 1U);
  EXPECT_EQ(model.outputs[0].name, "descriptors");
  EXPECT_EQ(model.outputs[0].shape[1], 8);
}

TEST(OnnxModel, IsADescriptorNetwork) {
  const DescriptorModel model =
      descriptor_model(read_model(onnx_model({.input_channels = 3, .channels = 12})), "tiny.onnx");
  EXPECT_EQ(model.input, "input");
  EXPECT_EQ(model.input_channels, 3);
  EXPECT_EQ(model.descriptors, "descriptors");
  EXPECT_EQ(model.channels, 12);
  // The only output may have any name.
  EXPECT_EQ(descriptor_model(read_model(onnx_model({.output = "features"})), "tiny.onnx").descriptors, "features");
}

// Before format 4 the constants were listed as inputs as well.
TEST(OnnxModel, ConstantsAreNoInputs) {
  ProtoMessage weights, value, graph, model;
  weights.text(8, "weights");
  value.text(1, "weights");
  graph.message(11, value).message(5, weights);
  EXPECT_TRUE(read_model(model.number(1, 3).message(7, graph).bytes()).inputs.empty());
}

TEST(OnnxModel, SaysWhatIsWrongWithANetwork) {
  EXPECT_THAT(rejection(onnx_model({.input_channels = 2})), HasSubstr("input (1 x 2 x any x any)"));
  EXPECT_THAT(rejection(onnx_model({.input_sides = {480, 640}})), HasSubstr("input (1 x 1 x 480 x 640)"));
  EXPECT_THAT(rejection(onnx_model({.element_type = 7})), HasSubstr("no floats"));
  EXPECT_THAT(rejection(onnx_model({.channels = 3})), HasSubstr("4 to 256 channels"));
  EXPECT_THAT(rejection(onnx_model({.external_weights = true})), HasSubstr("weights in another file"));
}

TEST(OnnxModel, RejectsWhatIsNoModel) {
  EXPECT_THAT(rejection(""), HasSubstr("an empty file"));
  EXPECT_THAT(rejection("\x08\x08"), HasSubstr("no graph"));
  EXPECT_THAT(rejection("not a model"), HasSubstr("not a network that can be read"));
}

// Cut off anywhere it is rejected, and never read beyond its end.
TEST(OnnxModel, RejectsEveryBeginningOfAModel) {
  const std::string whole = onnx_model({.channels = 4});
  std::size_t accepted = 0;
  for (std::size_t size = 0; size < whole.size(); size += size + 40 < whole.size() ? std::size_t{7} : std::size_t{1}) {
    const std::string cut = whole.substr(0, size);
    const std::vector<std::uint8_t> exact(cut.begin(), cut.end());
    try {
      read_onnx_model(exact, "cut.onnx");
      ++accepted;
    } catch (const Error&) {
    }
  }
  // Whole but for the set of operators, which comes last.
  EXPECT_LE(accepted, 1U);
}

}  // namespace
}  // namespace nadir
