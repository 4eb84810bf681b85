// The autopilot's end of a link over UDP, written with the official C headers: they are the judge of what we send.
#pragma once

#include <ardupilotmega/mavlink.h>
#include <gtest/gtest.h>
#include <poll.h>

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "mavlink/transport.hpp"

namespace nadir::test {

class LinkPeer {
 public:
  explicit LinkPeer(const std::string& endpoint = "udpin:127.0.0.1:0")
      : transport_(make_transport(parse_endpoint(endpoint))) {
    read(0);
  }

  // What the link under test connects to.
  std::string endpoint() const { return "udpout:127.0.0.1:" + std::to_string(transport_->local_port()); }

  // At udpin, sends only after it has received from the other end.
  void send(const mavlink_message_t& message) {
    std::uint8_t bytes[MAVLINK_MAX_PACKET_LEN];
    const std::size_t size = mavlink_msg_to_send_buffer(bytes, &message);
    EXPECT_TRUE(transport_->send({bytes, size}));
  }

  void send(ByteView frame) { EXPECT_TRUE(transport_->send(frame)); }

  // Until `done` holds for what was received; the deadline is there only so that a dead link fails instead of hanging.
  void listen_until(const std::function<bool()>& done) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(2);
    while (!done()) {
      ASSERT_LT(std::chrono::steady_clock::now(), deadline) << "the link is silent";
      read(100);
    }
  }

  // Whatever has come by now.
  void listen() { read(0); }

  // Of one kind, in the order in which they came.
  std::vector<mavlink_message_t> received(std::uint32_t id) const {
    std::vector<mavlink_message_t> found;
    for (const mavlink_message_t& message : messages_) {
      if (message.msgid == id) found.push_back(message);
    }
    return found;
  }

  std::vector<mavlink_gps_input_t> fixes() const {
    std::vector<mavlink_gps_input_t> found;
    for (const mavlink_message_t& message : received(MAVLINK_MSG_ID_GPS_INPUT)) {
      mavlink_msg_gps_input_decode(&message, &found.emplace_back());
    }
    return found;
  }

 private:
  void read(int wait_ms) {
    pollfd ready{transport_->descriptor(), POLLIN, 0};
    if (wait_ms > 0) ::poll(&ready, 1, wait_ms);
    transport_->advance(1'000'000, [&](const Transport::Arrival& arrival) {
      transport_->follow_sender(1'000'000);
      for (const std::uint8_t byte : arrival.bytes) {
        mavlink_message_t message;
        mavlink_status_t status;
        if (mavlink_frame_char_buffer(&buffer_, &status_, byte, &message, &status) == MAVLINK_FRAMING_OK) {
          messages_.push_back(message);
        }
      }
    });
  }

  std::unique_ptr<Transport> transport_;
  mavlink_message_t buffer_{};
  mavlink_status_t status_{};
  std::vector<mavlink_message_t> messages_;
};

}  // namespace nadir::test
