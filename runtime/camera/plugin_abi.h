/* What a camera plug-in offers: one symbol, nadir_camera_plugin(), in C, so that it may be built by another compiler and
 * link libraries that the service must not. runtime/camera/plugin/video_plugin.cpp is one.
 *
 * All functions are called from one thread at a time. Nothing may throw. Texts are UTF-8; an error text is cut to its
 * buffer and ends with a NUL. */
#ifndef NADIR_CAMERA_PLUGIN_ABI_H
#define NADIR_CAMERA_PLUGIN_ABI_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define NADIR_CAMERA_PLUGIN_VERSION 2

/* NOLINTBEGIN(modernize-use-using): this is C */
typedef struct NadirPluginFrame {
  const uint8_t* data; /* owned by the plug-in, valid until the next read or close */
  size_t size;
  int32_t width; /* 0: data is an encoded image (JPEG, PNG, WebP) */
  int32_t height;
  int32_t channels;    /* 1: grey, 3: BGR; rows from the top without padding */
  double media_time_s; /* since the start of a recording, played at its own speed; below 0: live */
  double age_s;        /* since the exposure, by a stamp of the camera or its driver; below 0: not known */
} NadirPluginFrame;

enum { NADIR_CAMERA_FRAME = 1, NADIR_CAMERA_NOTHING = 0, NADIR_CAMERA_ENDED = -1, NADIR_CAMERA_TROUBLE = -2 };

typedef struct NadirCameraPlugin {
  uint32_t version; /* NADIR_CAMERA_PLUGIN_VERSION that it was built with */
  const char* name;

  /* source: as given to --camera, "video:flight.mp4". NULL: it cannot be opened, and error says why. */
  void* (*open)(const char* source, char* error, size_t error_size);

  /* One of NADIR_CAMERA_*; may wait for about timeout_ms. After NADIR_CAMERA_TROUBLE the camera is closed and reopened. */
  int32_t (*read)(void* camera, int32_t timeout_ms, NadirPluginFrame* frame, char* error, size_t error_size);

  void (*close)(void* camera);
} NadirCameraPlugin;
/* NOLINTEND(modernize-use-using) */

const NadirCameraPlugin* nadir_camera_plugin(void);

#ifdef __cplusplus
}
#endif
#endif
