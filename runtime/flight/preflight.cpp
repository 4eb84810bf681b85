#include "flight/preflight.hpp"

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "cli/terminal.hpp"
#include "fixes/autopilot_backend.hpp"
#include "imagery/frame_image.hpp"
#include "mavlink/closed_link.hpp"
#include "mavlink/link.hpp"

namespace nadir {
namespace {

constexpr std::chrono::milliseconds kLook{100};
constexpr double kHelloPeriod_s = 1;

// Of an encoded frame; nullopt: no image.
std::optional<std::pair<int, int>> size_of(const CameraFrame& frame) {
  if (frame.raw) return std::pair(frame.raw->width, frame.raw->height);
  try {
    const cv::Mat image = decode_frame(frame.bytes, Colour::grey, frame.name);
    return std::pair(image.cols, image.rows);
  } catch (const Error&) {
    return std::nullopt;
  }
}

std::string silence(const LinkCounts& counts, const std::set<MavlinkAddress>& others, const Transport& transport,
                    bool is_signed) {
  if (const auto closed = closed_link(transport)) return closed->reason;
  const std::uint64_t unsigned_frames = counts.signatures.without;
  const std::uint64_t invalid = counts.signatures.wrong + counts.signatures.replayed + counts.signatures.too_old;
  if (is_signed && invalid > 0)
    return fmt::format("{} frames whose signature is not valid: another key or time", invalid);
  if (is_signed && unsigned_frames > 0) return fmt::format("{} frames without a signature", unsigned_frames);
  if (others.empty()) return "nothing";
  std::string names;
  for (const MavlinkAddress& other : others) {
    names += fmt::format("{}{}/{}", names.empty() ? "" : ", ", other.system, other.component);
  }
  return "only frames of " + names;
}

}  // namespace

PartCheck check_camera(CameraSource& source, const std::optional<CameraModel>& camera, const FlightClock& clock,
                       double limit_s) {
  const double start_s = clock.monotonic_s();
  std::string failure = "no frame";
  while (clock.monotonic_s() - start_s < limit_s && !interrupt_requested()) {
    const CameraReading reading = source.next(kLook, {});
    if (reading.status == CameraStatus::timeout) continue;
    if (reading.status != CameraStatus::frame) {
      failure = reading.detail;
      continue;
    }
    PartCheck check;
    const auto size = size_of(reading.frame);
    const std::string text = size ? fmt::format("{} x {}", size->first, size->second) : "no image";
    check.found = fmt::format("frame {}, {}, after {:.1f} s", reading.frame.name, text, clock.monotonic_s() - start_s);
    if (camera && size != std::pair(camera->width, camera->height)) {
      check.findings.add(
          {.code = "camera.size",
           .where = source.describe(),
           .expected = fmt::format("frames of {} x {}, as the airframe file says", camera->width, camera->height),
           .found = text,
           .fix = "set the camera to that size, or calibrate it at this one"});
    }
    return check;
  }
  PartCheck check{failure, {}};
  check.findings.add({.code = "camera.no_frame",
                      .where = source.describe(),
                      .expected = fmt::format("a frame within {:.0f} s", limit_s),
                      .found = failure,
                      .fix = "start the camera, and check --camera"});
  return check;
}

PartCheck find_stream(std::unique_ptr<Transport> transport, const Airframe& airframe, std::optional<Signing> signing,
                      VideoStreamFinder& finder, const FlightClock& clock, double limit_s) {
  MavlinkLink link(std::move(transport), {airframe.system, airframe.component}, std::move(signing),
                   MavlinkAddress{airframe.system, airframe.autopilot});
  const double start_s = clock.monotonic_s();
  const auto us = [](double seconds) { return std::llround(seconds * 1e6); };
  Cadence hello(kHelloPeriod_s, start_s);
  for (double now_s = start_s; now_s - start_s < limit_s && !interrupt_requested(); now_s = clock.monotonic_s()) {
    link.advance(us(now_s), [&](const ReceivedMessage& got) { finder.on_message(got.source, got.message); });
    if (hello.due(now_s)) link.send(OwnHeartbeat{SystemState::standby}, us(now_s));
    for (const CommandLong& request : finder.requests(now_s)) link.send(request, us(now_s));
    if (const auto uri = finder.found()) return {*uri, {}};
    pollfd waited{link.transport().descriptor(), link.transport().events(), 0};
    ::poll(&waited, 1, static_cast<int>(kLook.count()));
  }
  PartCheck check{finder.offered(), {}};
  check.findings.add({.code = "camera.no_stream",
                      .where = "--camera",
                      .expected = fmt::format(
                          "an RTSP stream of the MAVLink camera, of the calibrated size, within {:.0f} s", limit_s),
                      .found = check.found,
                      .fix = "check the camera's component id, and that the autopilot passes its messages on"});
  return check;
}

PartCheck check_autopilot(std::unique_ptr<Transport> transport, const Airframe& airframe,
                          std::optional<Signing> signing, const FlightClock& clock, double limit_s) {
  const MavlinkAddress own{airframe.system, airframe.component}, autopilot{airframe.system, airframe.autopilot};
  const bool is_signed = signing.has_value();
  MavlinkLink link(std::move(transport), own, std::move(signing), autopilot);
  const double start_s = clock.monotonic_s();
  const auto us = [](double seconds) { return std::llround(seconds * 1e6); };
  Cadence hello(kHelloPeriod_s, start_s);
  std::set<MavlinkAddress> others;
  std::optional<Heartbeat> found;
  for (double now_s = start_s; now_s - start_s < limit_s && !found && !interrupt_requested();
       now_s = clock.monotonic_s()) {
    link.advance(us(now_s), [&](const ReceivedMessage& received) {
      if (received.source != autopilot) others.insert(received.source);
      const auto* heartbeat = std::get_if<Heartbeat>(&received.message);
      if (received.source == autopilot && heartbeat != nullptr && heartbeat->is_autopilot) found = *heartbeat;
    });
    if (hello.due(now_s)) link.send(OwnHeartbeat{SystemState::standby}, us(now_s));
    pollfd waited{link.transport().descriptor(), link.transport().events(), 0};
    ::poll(&waited, 1, static_cast<int>(kLook.count()));
  }
  if (found) {
    const std::string name = name_of_autopilot(*found);
    PartCheck check{fmt::format("{}/{}, {}, {}, after {:.1f} s", autopilot.system, autopilot.component, name,
                                is_signed ? "signed" : "NOT SIGNED", clock.monotonic_s() - start_s),
                    {}};
    if (!is_supported(found->autopilot)) {
      check.findings.add({.code = "autopilot.unsupported",
                          .where = "--autopilot",
                          .expected = fmt::format("{} by its heartbeat", supported_autopilots()),
                          .found = name,
                          .fix = "other autopilots take no position from Nadir"});
    }
    return check;
  }
  const auto closed = closed_link(link.transport());
  PartCheck check{silence(link.counts(), others, link.transport(), is_signed), {}};
  check.findings.add({.code = "autopilot.silent",
                      .where = "--autopilot",
                      .expected = fmt::format("a heartbeat of {}/{}{} within {:.0f} s", autopilot.system,
                                              autopilot.component, is_signed ? ", signed with our key," : "", limit_s),
                      .found = check.found,
                      .fix = closed ? closed->fix
                                    : "check the address, the wiring, the system id in the airframe file, and the key "
                                      "(nadir provision autopilot)"});
  return check;
}

}  // namespace nadir
