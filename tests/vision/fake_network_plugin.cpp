// A network plug-in for the tests: what it does follows from the name of the model's input.
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>
#include <vector>

#include "vision/network_plugin_abi.h"

namespace {

struct Network {
  std::string kind;
  std::vector<float> values;
  int runs = 0;
};

void say(const char* what, char* error, size_t size) { std::snprintf(error, size, "%s", what); }

#ifdef FAKE_WITHOUT_LIBRARY
const char* runtime_of(char* error, size_t size) {
  say("libonnxruntime.so.1: cannot open shared object file", error, size);
  return nullptr;
}
#else
const char* runtime_of(char*, size_t) { return "Fake Runtime 1.0"; }
#endif

void* open_network(const void*, size_t, const char* input, const char* const*, size_t, char* error, size_t error_size) {
  if (input == std::string("unknown operator")) {
    say("no kernel for it", error, error_size);
    return nullptr;
  }
  return new Network{input, {}, 0};
}

int32_t run_network(void* opaque, const NadirNetworkTensor* input, NadirNetworkTensor* results, char* error,
                    size_t error_size) {
  auto& network = *static_cast<Network*>(opaque);
  ++network.runs;
  if (network.kind == "fails" || (network.kind == "fails later" && network.runs > 1)) {
    say("out of memory", error, error_size);
    return 1;
  }
  const int64_t rows = input->shape[2] / 8, columns = input->shape[3] / 8;
  network.values.assign(static_cast<size_t>(8 * rows * columns), 1.0F);
  results[0] = {network.values.data(), {1, 8, rows, columns}};
  if (network.kind == "nan") network.values.back() = std::numeric_limits<float>::quiet_NaN();
  if (network.kind == "half") results[0].shape[2] = rows / 2;
  if (network.kind == "nothing") results[0].data = nullptr;
  return 0;
}

void close_network(void* network) { delete static_cast<Network*>(network); }

#ifndef FAKE_PLUGIN_VERSION
#define FAKE_PLUGIN_VERSION NADIR_NETWORK_PLUGIN_VERSION
#endif
constexpr NadirNetworkPlugin kPlugin{FAKE_PLUGIN_VERSION, runtime_of, open_network, run_network, close_network};

}  // namespace

extern "C" const NadirNetworkPlugin* nadir_network_plugin() { return &kPlugin; }
