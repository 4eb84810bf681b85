// Networks by ONNX Runtime, which is loaded when the first one is opened (dlopen) and linked by nothing: one plug-in
// works with every version from kLeastVersion on, because the C interface only ever grows at its end. Found as
// libonnxruntime.so.1 where the loader looks, or beside this plug-in.
//
// One thread, no arena that keeps memory, no telemetry: the same result for the same input on one kind of processor,
// and memory that is bounded by the size of the image.
#include <dlfcn.h>
#include <onnxruntime_c_api.h>

#include <array>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "vision/network_plugin_abi.h"

namespace {

constexpr std::uint32_t kLeastVersion = 15;  // of the interface: ONNX Runtime 1.15
static_assert(kLeastVersion <= ORT_API_VERSION);

// The interface, or the reason why there is none.
struct Runtime {
  const OrtApi* api = nullptr;
  std::string name, why;

  Runtime() {
    void* library = nullptr;
    for (const char* file : {"libonnxruntime.so.1", "libonnxruntime.so"}) {
      library = ::dlopen(file, RTLD_NOW | RTLD_LOCAL);  // stays: it cannot be unloaded safely
      if (library != nullptr) break;
      const char* text = ::dlerror();  // NOLINT(concurrency-mt-unsafe): glibc keeps one text per thread
      if (why.empty() && text != nullptr) why = text;
    }
    if (library == nullptr) return;
    using Entry = const OrtApiBase* (*)();
    const auto entry = reinterpret_cast<Entry>(::dlsym(library, "OrtGetApiBase"));
    const OrtApiBase* base = entry == nullptr ? nullptr : entry();
    if (base == nullptr) {
      why = "libonnxruntime has no OrtGetApiBase()";
      return;
    }
    name = std::string("ONNX Runtime ") + base->GetVersionString();
    api = base->GetApi(kLeastVersion);
    if (api == nullptr) why = name + " is older than 1." + std::to_string(kLeastVersion);
  }
};

const Runtime& runtime() {
  static const Runtime one;
  return one;
}

void say(const std::string& text, char* error, std::size_t size) {
  if (size > 0) std::snprintf(error, size, "%s", text.c_str());
}

struct Failure {
  std::string text;
};

void check(OrtStatus* status) {
  if (status == nullptr) return;
  const OrtApi& api = *runtime().api;
  Failure failure{api.GetErrorMessage(status)};
  api.ReleaseStatus(status);
  throw failure;
}

template <typename T>
using Owned = std::unique_ptr<T, void (*)(T*)>;

struct Network {
  Owned<OrtEnv> environment{nullptr, runtime().api->ReleaseEnv};
  Owned<OrtSession> session{nullptr, runtime().api->ReleaseSession};
  Owned<OrtMemoryInfo> memory{nullptr, runtime().api->ReleaseMemoryInfo};
  std::string input;
  std::vector<std::string> outputs;
  std::vector<Owned<OrtValue>> results;  // of the last run

  Network(const void* model, std::size_t size) {
    const OrtApi& api = *runtime().api;
    OrtEnv* env = nullptr;
    check(api.CreateEnv(ORT_LOGGING_LEVEL_FATAL, "nadir", &env));
    environment.reset(env);
    check(api.DisableTelemetryEvents(env));
    OrtSessionOptions* made = nullptr;
    check(api.CreateSessionOptions(&made));
    const Owned<OrtSessionOptions> options(made, api.ReleaseSessionOptions);
    check(api.SetIntraOpNumThreads(made, 1));
    check(api.SetInterOpNumThreads(made, 1));
    check(api.SetSessionExecutionMode(made, ORT_SEQUENTIAL));
    check(api.SetSessionGraphOptimizationLevel(made, ORT_ENABLE_ALL));
    check(api.DisableCpuMemArena(made));
    check(api.DisableMemPattern(made));
    OrtSession* opened = nullptr;
    check(api.CreateSessionFromArray(env, model, size, made, &opened));
    session.reset(opened);
    OrtMemoryInfo* info = nullptr;
    check(api.CreateCpuMemoryInfo(OrtDeviceAllocator, OrtMemTypeDefault, &info));
    memory.reset(info);
  }

  void run(const NadirNetworkTensor& image, NadirNetworkTensor* found) {
    const OrtApi& api = *runtime().api;
    results.clear();
    std::size_t values = 1;
    for (const std::int64_t side : image.shape) values *= static_cast<std::size_t>(side);
    OrtValue* made = nullptr;
    // Not written to: the interface has no tensor of constants.
    check(api.CreateTensorWithDataAsOrtValue(memory.get(), const_cast<float*>(image.data), values * sizeof(float),
                                             image.shape, 4, ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT, &made));
    const Owned<OrtValue> tensor(made, api.ReleaseValue);
    std::vector<const char*> names;
    for (const std::string& name : outputs) names.push_back(name.c_str());
    std::vector<OrtValue*> raw(outputs.size(), nullptr);
    const char* input_name = input.c_str();
    const OrtValue* inputs = tensor.get();
    OrtStatus* status =
        api.Run(session.get(), nullptr, &input_name, &inputs, 1, names.data(), names.size(), raw.data());
    for (OrtValue* value : raw) results.emplace_back(value, api.ReleaseValue);
    check(status);
    for (std::size_t i = 0; i < results.size(); ++i) found[i] = tensor_of(*results[i], outputs[i]);
  }

 private:
  static NadirNetworkTensor tensor_of(OrtValue& value, const std::string& name) {
    const OrtApi& api = *runtime().api;
    OrtTensorTypeAndShapeInfo* made = nullptr;
    check(api.GetTensorTypeAndShape(&value, &made));
    const Owned<OrtTensorTypeAndShapeInfo> info(made, api.ReleaseTensorTypeAndShapeInfo);
    ONNXTensorElementDataType type = ONNX_TENSOR_ELEMENT_DATA_TYPE_UNDEFINED;
    check(api.GetTensorElementType(made, &type));
    std::size_t sides = 0;
    check(api.GetDimensionsCount(made, &sides));
    NadirNetworkTensor tensor{};
    if (type != ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT || sides != std::size(tensor.shape)) {
      throw Failure{name + " is no tensor of floats with four dimensions"};
    }
    check(api.GetDimensions(made, tensor.shape, sides));
    void* data = nullptr;
    check(api.GetTensorMutableData(&value, &data));
    tensor.data = static_cast<const float*>(data);
    return tensor;
  }
};

const char* runtime_name(char* error, std::size_t error_size) {
  try {
    const Runtime& one = runtime();
    if (one.api != nullptr) return one.name.c_str();
    say(one.why, error, error_size);
  } catch (...) {
    say("out of memory", error, error_size);
  }
  return nullptr;
}

void* open_network(const void* model, std::size_t size, const char* input, const char* const* outputs,
                   std::size_t output_count, char* error, std::size_t error_size) {
  if (runtime_name(error, error_size) == nullptr) return nullptr;
  try {
    auto network = std::make_unique<Network>(model, size);
    network->input = input;
    network->outputs.assign(outputs, outputs + output_count);
    return network.release();
  } catch (const Failure& failure) {
    say(failure.text, error, error_size);
  } catch (...) {
    say("out of memory", error, error_size);
  }
  return nullptr;
}

std::int32_t run_network(void* network, const NadirNetworkTensor* input, NadirNetworkTensor* results, char* error,
                         std::size_t error_size) {
  try {
    static_cast<Network*>(network)->run(*input, results);
    return 0;
  } catch (const Failure& failure) {
    say(failure.text, error, error_size);
  } catch (...) {
    say("out of memory", error, error_size);
  }
  return 1;
}

void close_network(void* network) { delete static_cast<Network*>(network); }

}  // namespace

const NadirNetworkPlugin* nadir_network_plugin(void) {
  static const NadirNetworkPlugin table{NADIR_NETWORK_PLUGIN_VERSION, runtime_name, open_network, run_network,
                                        close_network};
  return &table;
}
