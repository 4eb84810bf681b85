// The plug-in nadir_camera_gstreamer: any pipeline that GStreamer's command line can describe, from libcamera, ARGUS,
// NVMM, MIPI or an industrial camera's own element. The only place of the runtime that links GStreamer.
//
// The pipeline ends before the sink: what it delivers is converted to grey or BGR, JPEG is passed as it is. Only the
// latest frame is kept. Live sources stamp each buffer with the time of its capture on the pipeline's clock; the
// difference to that clock's present time is the frame's age.
#include <gst/gst.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "camera/plugin_abi.h"

namespace {

constexpr std::string_view kKind = "gstreamer:";
constexpr GstClockTime kOpenTimeout = 4 * GST_SECOND;
constexpr const char* kDelivered = "video/x-raw,format=(string){GRAY8,BGR}; image/jpeg";

struct Unref {
  void operator()(gpointer object) const { gst_object_unref(object); }
  void operator()(GstCaps* caps) const { gst_caps_unref(caps); }
  void operator()(GstSample* sample) const { gst_sample_unref(sample); }
  void operator()(GstMessage* message) const { gst_message_unref(message); }
  void operator()(GError* error) const { g_error_free(error); }
  void operator()(gchar* text) const { g_free(text); }
};
template <typename T>
using Owned = std::unique_ptr<T, Unref>;

struct Pipeline {
  Owned<GstElement> whole;
  GstElement* sink = nullptr;  // of `whole`
  bool live = false;           // its stamps are times of capture
  std::vector<std::uint8_t> pixels;

  ~Pipeline() {
    if (whole) gst_element_set_state(whole.get(), GST_STATE_NULL);
  }
};

void set_error(std::string_view what, char* error, size_t size) {
  if (size == 0) return;
  const size_t length = std::min(what.size(), size - 1);
  std::memcpy(error, what.data(), length);
  error[length] = '\0';
}

// What the pipeline complained of or that it ended, if it did.
std::optional<std::string> complaint(const Pipeline& pipeline) {
  const Owned<GstBus> bus(gst_element_get_bus(pipeline.whole.get()));
  const auto kinds = static_cast<GstMessageType>(GST_MESSAGE_ERROR | GST_MESSAGE_EOS);
  const Owned<GstMessage> message(gst_bus_pop_filtered(bus.get(), kinds));
  if (!message) return std::nullopt;
  if (GST_MESSAGE_TYPE(message.get()) == GST_MESSAGE_EOS) return "the pipeline has ended";
  GError* error = nullptr;
  gchar* details = nullptr;
  gst_message_parse_error(message.get(), &error, &details);
  const Owned<GError> owned_error(error);
  const Owned<gchar> owned_details(details);
  const Owned<gchar> element(gst_object_get_name(message->src));
  return std::string(element.get()) + ": " + error->message;
}

// Adds an element behind `last`; null when this GStreamer has no such element or when it does not fit.
GstElement* append(GstElement* pipeline, GstElement* last, const char* kind, GstCaps* caps) {
  GstElement* element = gst_element_factory_make(kind, nullptr);
  if (element == nullptr) return nullptr;
  if (caps != nullptr) g_object_set(element, "caps", caps, nullptr);
  gst_bin_add(GST_BIN(pipeline), element);
  return gst_element_link(last, element) != FALSE ? element : nullptr;
}

bool delivers_raw_video(GstElement* source) {
  const Owned<GstPad> pad(gst_element_get_static_pad(source, "src"));
  const Owned<GstCaps> offered(gst_pad_query_caps(pad.get(), nullptr)), raw(gst_caps_from_string("video/x-raw"));
  return gst_caps_can_intersect(offered.get(), raw.get()) != FALSE;
}

// Null, and the reason in `why`.
std::unique_ptr<Pipeline> build(const std::string& description, std::string& why) {
  // A description may end with caps: only in front of an element they are a filter.
  const std::string ended = description + " ! identity silent=true";
  GError* error = nullptr;
  GstElement* source =
      gst_parse_bin_from_description_full(ended.c_str(), TRUE, nullptr, GST_PARSE_FLAG_FATAL_ERRORS, &error);
  const Owned<GError> owned(error);
  if (source == nullptr) {
    why = error != nullptr ? error->message : "not a pipeline";
    return nullptr;
  }
  auto pipeline = std::make_unique<Pipeline>();
  GstElement* whole = gst_pipeline_new(nullptr);
  pipeline->whole.reset(static_cast<GstElement*>(gst_object_ref_sink(whole)));
  gst_bin_add(GST_BIN(whole), source);
  GstElement* last = delivers_raw_video(source) ? append(whole, source, "videoconvert", nullptr) : source;
  const Owned<GstCaps> delivered(gst_caps_from_string(kDelivered));
  if (last != nullptr) pipeline->sink = append(whole, last, "appsink", delivered.get());
  if (pipeline->sink == nullptr) {
    why =
        "it delivers neither raw video nor JPEG, or this GStreamer lacks videoconvert and appsink "
        "(gstreamer1.0-plugins-base)";
    return nullptr;
  }
  g_object_set(pipeline->sink, "max-buffers", 1U, "drop", TRUE, "sync", FALSE, nullptr);
  return pipeline;
}

// The state that was asked for, or what came of it within the time allowed.
GstStateChangeReturn reach(GstElement* pipeline, GstState state) {
  const GstStateChangeReturn change = gst_element_set_state(pipeline, state);
  return change == GST_STATE_CHANGE_ASYNC ? gst_element_get_state(pipeline, nullptr, nullptr, kOpenTimeout) : change;
}

// The reason why not, if so. A paused camera delivers nothing, by which GStreamer knows what is live.
std::optional<std::string> start(Pipeline& pipeline) {
  GstStateChangeReturn change = reach(pipeline.whole.get(), GST_STATE_PAUSED);
  pipeline.live = change == GST_STATE_CHANGE_NO_PREROLL;
  if (change != GST_STATE_CHANGE_FAILURE && change != GST_STATE_CHANGE_ASYNC) {
    change = reach(pipeline.whole.get(), GST_STATE_PLAYING);
  }
  if (change == GST_STATE_CHANGE_SUCCESS || change == GST_STATE_CHANGE_NO_PREROLL) return std::nullopt;
  if (auto said = complaint(pipeline)) return said;
  return change == GST_STATE_CHANGE_ASYNC ? "no frame within 4 s" : "the pipeline does not start";
}

void* open_camera(const char* source, char* error, size_t error_size) {
  GError* failed = nullptr;
  if (gst_init_check(nullptr, nullptr, &failed) == FALSE) {
    const Owned<GError> owned(failed);
    set_error(failed == nullptr ? "GStreamer does not start" : failed->message, error, error_size);
    return nullptr;
  }
  std::string why;
  auto pipeline = build(std::string(std::string_view(source).substr(kKind.size())), why);
  if (pipeline) {
    if (auto reason = start(*pipeline)) {
      why = std::move(*reason);
      pipeline.reset();
    }
  }
  if (!pipeline) set_error(why, error, error_size);
  return pipeline.release();
}

// Seconds since the capture by the buffer's stamp; below 0 without one.
double age_s(const Pipeline& pipeline, GstSample* sample, GstBuffer* buffer) {
  if (!pipeline.live || !GST_BUFFER_PTS_IS_VALID(buffer)) return -1;
  const GstSegment* segment = gst_sample_get_segment(sample);
  const GstClockTime exposed = gst_segment_to_running_time(segment, GST_FORMAT_TIME, GST_BUFFER_PTS(buffer));
  const Owned<GstClock> clock(gst_element_get_clock(pipeline.whole.get()));
  if (!GST_CLOCK_TIME_IS_VALID(exposed) || !clock) return -1;
  const GstClockTime now = gst_clock_get_time(clock.get()) - gst_element_get_base_time(pipeline.whole.get());
  return now > exposed ? static_cast<double>(now - exposed) / GST_SECOND : 0;
}

// Rows of raw video are padded to multiples of four bytes. False when the buffer is not what its caps say.
bool take_pixels(Pipeline& pipeline, const GstStructure* form, const GstMapInfo& memory, NadirPluginFrame& frame) {
  gint width = 0, height = 0;
  const gchar* format = gst_structure_get_string(form, "format");
  if (format == nullptr || gst_structure_get_int(form, "width", &width) == FALSE ||
      gst_structure_get_int(form, "height", &height) == FALSE || width <= 0 || height <= 0) {
    return false;
  }
  const int channels = std::string_view(format) == "GRAY8" ? 1 : 3;
  const auto row = static_cast<std::size_t>(width) * static_cast<std::size_t>(channels);
  const std::size_t stride = (row + 3) / 4 * 4, rows = static_cast<std::size_t>(height);
  if (memory.size < stride * (rows - 1) + row) return false;
  pipeline.pixels.resize(row * rows);
  for (std::size_t y = 0; y < rows; ++y) std::memcpy(&pipeline.pixels[y * row], memory.data + y * stride, row);
  frame.width = width;
  frame.height = height;
  frame.channels = channels;
  return true;
}

int32_t read_camera(void* camera, int32_t timeout_ms, NadirPluginFrame* frame, char* error, size_t error_size) {
  Pipeline& pipeline = *static_cast<Pipeline*>(camera);
  GstSample* pulled = nullptr;
  const auto timeout = static_cast<guint64>(timeout_ms) * GST_MSECOND;
  g_signal_emit_by_name(pipeline.sink, "try-pull-sample", timeout, &pulled);
  const Owned<GstSample> sample(pulled);
  if (!sample) {
    const auto said = complaint(pipeline);
    if (!said) return NADIR_CAMERA_NOTHING;
    set_error(*said, error, error_size);
    return NADIR_CAMERA_TROUBLE;
  }
  GstBuffer* buffer = gst_sample_get_buffer(sample.get());
  const GstCaps* caps = gst_sample_get_caps(sample.get());
  GstMapInfo memory;
  if (buffer == nullptr || caps == nullptr || gst_buffer_map(buffer, &memory, GST_MAP_READ) == FALSE) {
    set_error("a frame that cannot be read", error, error_size);
    return NADIR_CAMERA_TROUBLE;
  }
  *frame = {nullptr, 0, 0, 0, 0, -1, age_s(pipeline, sample.get(), buffer)};
  const GstStructure* form = gst_caps_get_structure(caps, 0);
  bool taken = true;
  if (gst_structure_has_name(form, "image/jpeg") != FALSE) {
    pipeline.pixels.assign(memory.data, memory.data + memory.size);
  } else {
    taken = take_pixels(pipeline, form, memory, *frame);
  }
  gst_buffer_unmap(buffer, &memory);
  frame->data = pipeline.pixels.data();
  frame->size = pipeline.pixels.size();
  if (taken) return NADIR_CAMERA_FRAME;
  set_error("a frame whose size does not fit its format", error, error_size);
  return NADIR_CAMERA_TROUBLE;
}

void close_camera(void* camera) { delete static_cast<Pipeline*>(camera); }

constexpr NadirCameraPlugin kPlugin{NADIR_CAMERA_PLUGIN_VERSION, "gstreamer", open_camera, read_camera, close_camera};

}  // namespace

extern "C" const NadirCameraPlugin* nadir_camera_plugin() { return &kPlugin; }
