// Descriptor networks from ONNX files, run by an inference library behind a plug-in (network_plugin_abi.h): what is
// here links none. The plug-in nadir_network_onnxruntime.so loads ONNX Runtime where it is installed.
//
// A file is read once: its bytes are hashed, checked (onnx_model.hpp) and given to the library, so that nothing can
// change in between.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/digest.hpp"
#include "vision/dense_descriptors.hpp"

namespace nadir {

struct NetworkFile {
  std::filesystem::path model;
  std::optional<Sha256> digest;  // nothing: any
};

// What was opened, before it is relied on.
struct OpenedNetwork {
  std::shared_ptr<DenseDescriptorNetwork> network;
  Sha256 digest;        // of the model's file
  std::string runtime;  // "ONNX Runtime 1.32.0"
};

// plugins: folders that are searched for the plug-in. Throws Error, which says what is missing or wrong: the file, its
// digest, what it is a model of, the plug-in, the library, or that the network does not give what it should for a
// picture of a few pixels.
OpenedNetwork open_network(const NetworkFile& file, const std::vector<std::filesystem::path>& plugins);

// Milliseconds of processor time that a frame's description takes: the least of a few, after one that warms up.
double network_cost_ms(DenseDescriptorNetwork& network, const std::function<double()>& processor_s);

}  // namespace nadir
