/* What a network plug-in offers: one symbol, nadir_network_plugin(), in C, so that the program links no inference
 * library (libgeo/vision/plugin/onnxruntime_plugin.cpp is one).
 *
 * One network is used by one thread at a time. Nothing may throw. Texts are UTF-8; an error text is cut to its buffer
 * and ends with a NUL. */
#ifndef NADIR_NETWORK_PLUGIN_ABI_H
#define NADIR_NETWORK_PLUGIN_ABI_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define NADIR_NETWORK_PLUGIN_VERSION 1

/* NOLINTBEGIN(modernize-use-using): this is C */
typedef struct NadirNetworkTensor {
  const float* data; /* batch, channel, row, column; owned by the plug-in, valid until the next run or close */
  int64_t shape[4];
} NadirNetworkTensor;

typedef struct NadirNetworkPlugin {
  uint32_t version; /* NADIR_NETWORK_PLUGIN_VERSION that it was built with */

  /* The library behind it with its version, "ONNX Runtime 1.32.0". NULL: it cannot be used, and error says why. */
  const char* (*runtime)(char* error, size_t error_size);

  /* model: an ONNX file; may be freed afterwards. input, outputs: names of its tensors, as many as output_count.
   * NULL: it cannot be used, and error says why. */
  void* (*open)(const void* model, size_t size, const char* input, const char* const* outputs, size_t output_count,
                char* error, size_t error_size);

  /* One thread, no other threads' memory. input: as NadirNetworkTensor. results: output_count. 0, or another number and
   * error says why. */
  int32_t (*run)(void* network, const NadirNetworkTensor* input, NadirNetworkTensor* results, char* error,
                 size_t error_size);

  void (*close)(void* network);
} NadirNetworkPlugin;
/* NOLINTEND(modernize-use-using) */

const NadirNetworkPlugin* nadir_network_plugin(void);

#ifdef __cplusplus
}
#endif
#endif
