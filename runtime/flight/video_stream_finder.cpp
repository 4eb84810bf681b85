#include "flight/video_stream_finder.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "base/error.hpp"
#include "base/number_text.hpp"
#include "mavlink/commands.hpp"

namespace nadir {
namespace {

constexpr double kAsk_s = 1, kAskAgain_s = 10;
constexpr std::string_view kKind = "mavlink:", kRtsp = "rtsp://";
constexpr std::size_t kMostStreams = 16;

std::optional<int> number_within(std::string_view text, int low, int high) {
  const std::optional<int> number = whole_number<int>(text);
  return number && *number >= low && *number <= high ? number : std::nullopt;
}

// Nothing that ends a line of a log, or begins another argument.
bool is_address(const std::string& uri) {
  const bool plain = std::ranges::all_of(uri, [](unsigned char c) { return c > ' ' && c < 0x7f && c != '"'; });
  return plain && uri.starts_with(kRtsp) && uri.size() > kRtsp.size();
}

std::string printable(std::string text) {
  std::ranges::replace_if(
      text, [](unsigned char c) { return c < ' ' || c >= 0x7f; }, '?');
  return text;
}

}  // namespace

std::optional<MavlinkCamera> mavlink_camera(const std::string& source) {
  if (!source.starts_with(kKind)) return std::nullopt;
  const std::string_view rest = std::string_view(source).substr(kKind.size());
  const std::size_t colon = rest.find(':');
  const auto component = number_within(rest.substr(0, colon), 1, 255);
  const auto stream = colon == std::string_view::npos ? std::nullopt : number_within(rest.substr(colon + 1), 1, 255);
  if (!component || (colon != std::string_view::npos && !stream)) {
    throw UsageError({.what = "no MAVLink camera has this address",
                      .where = "--camera",
                      .expected = "mavlink:COMPONENT or mavlink:COMPONENT:STREAM, as mavlink:100",
                      .found = source});
  }
  return MavlinkCamera{static_cast<std::uint8_t>(*component), stream};
}

std::vector<CommandLong> VideoStreamFinder::requests(double now_s) {
  const std::scoped_lock lock(mutex_);
  if (asked_s_ && now_s - *asked_s_ < (chosen() ? kAskAgain_s : kAsk_s)) return {};
  asked_s_ = now_s;
  std::vector<CommandLong> due{request_message(camera_, StreamedMessage::video_streams)};
  if (!information_) due.push_back(request_message(camera_, StreamedMessage::camera_information));
  return due;
}

void VideoStreamFinder::on_message(MavlinkAddress source, const IncomingMessage& message) {
  if (source != camera_) return;
  const std::scoped_lock lock(mutex_);
  if (const auto* information = std::get_if<CameraInformation>(&message)) information_ = *information;
  const auto* stream = std::get_if<VideoStream>(&message);
  if (stream != nullptr && (streams_.contains(stream->id) || streams_.size() < kMostStreams)) {
    streams_[stream->id] = *stream;
  }
}

std::optional<std::string> VideoStreamFinder::found() const {
  const std::scoped_lock lock(mutex_);
  const auto stream = chosen();
  return stream ? std::optional(stream->uri) : std::nullopt;
}

std::string VideoStreamFinder::offered() const {
  const std::scoped_lock lock(mutex_);
  return what_it_said();
}

std::string VideoStreamFinder::uri() const {
  const std::scoped_lock lock(mutex_);
  if (const auto stream = chosen()) return stream->uri;
  throw Error({.what = "no video stream of the camera is known",
               .where = fmt::format("MAVLink component {}/{}", camera_.system, camera_.component),
               .expected = fmt::format("a stream{} over RTSP{}",
                                       wanted_.stream ? fmt::format(" with the number {}", *wanted_.stream) : "",
                                       width_ > 0 ? fmt::format(" of {} x {} pixels", width_, height_) : ""),
               .found = what_it_said(),
               .fix = "check the camera's component id, and that it sends through the autopilot's link"});
}

std::optional<VideoStream> VideoStreamFinder::chosen() const {
  std::optional<VideoStream> best;
  for (const auto& [id, stream] : streams_) {
    if (fits(stream) && (!best || (stream.running && !best->running))) best = stream;
  }
  return best;
}

// A size that the camera does not state is seen in the frames.
bool VideoStreamFinder::fits(const VideoStream& stream) const {
  const bool stated = width_ > 0 && stream.width > 0 && stream.height > 0;
  return stream.kind == VideoStream::Kind::rtsp && is_address(stream.uri) &&
         (!wanted_.stream || stream.id == *wanted_.stream) &&
         (!stated || (stream.width == width_ && stream.height == height_));
}

std::string VideoStreamFinder::what_it_said() const {
  constexpr const char* kKinds[] = {"RTSP", "RTP", "MPEG over TCP", "MPEG-TS", "another kind"};
  if (streams_.empty() && !information_) return "no answer";
  const std::string name =
      information_ ? printable(fmt::format("{} {}: ", information_->vendor, information_->model)) : std::string();
  if (streams_.empty()) return name + (information_->has_video_stream ? "no answer about its streams" : "no streams");
  std::string said;
  for (const auto& [id, stream] : streams_) {
    said += fmt::format("{}{}: {}, {} x {}", said.empty() ? "" : "; ", id,
                        kKinds[static_cast<std::size_t>(stream.kind)], stream.width, stream.height);
    if (stream.kind == VideoStream::Kind::rtsp && !is_address(stream.uri)) said += ", without an address";
  }
  return name + said;
}

CameraReading StreamCamera::next(std::chrono::milliseconds at_most, std::stop_token stop) {
  try {
    std::string uri = finder_.uri();
    if (!camera_ || uri != uri_) {
      camera_.reset();
      camera_ = open_(uri);
      uri_ = std::move(uri);
    }
  } catch (const std::exception& error) {
    return {CameraStatus::failure, {}, error.what()};
  }
  return camera_->next(at_most, std::move(stop));
}

std::string StreamCamera::describe() const { return camera_ ? camera_->describe() : "no stream yet"; }

}  // namespace nadir
