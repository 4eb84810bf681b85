// A link to another process over real sockets and a pseudo-terminal. Both ends go on as soon as something arrives; the
// deadline is there only so that a broken link fails instead of hanging.
#include "mavlink/link.hpp"

#include <gtest/gtest.h>
#include <poll.h>

#include <chrono>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <set>

#include "base/digest.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

const std::string kKeyHex(64, '5');
constexpr MavlinkAddress kUs{1, 191};

std::int64_t steady_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

std::int64_t system_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

class Peer {
 public:
  explicit Peer(const std::string& arguments, const std::string& key = kKeyHex)
      : pipe_(::popen((NADIR_PYTHON " " NADIR_PEER " " + arguments + " " + key).c_str(), "re")) {
    const std::string line = read_line();  // "port 5760", "path /dev/pts/3"
    place_ = line.substr(std::min(line.size(), std::size_t{5}));
  }
  ~Peer() { ::pclose(pipe_); }
  Peer(const Peer&) = delete;
  Peer& operator=(const Peer&) = delete;

  const std::string& place() const { return place_; }
  bool has_ended() const {
    pollfd ready{::fileno(pipe_), POLLIN, 0};
    return ::poll(&ready, 1, 0) > 0;
  }
  nlohmann::json report() { return nlohmann::json::parse(read_line()); }

 private:
  std::string read_line() {
    char buffer[4096] = "";
    if (std::fgets(buffer, sizeof buffer, pipe_) == nullptr) return {};
    std::string line(buffer);
    line.pop_back();
    return line;
  }
  std::FILE* pipe_;
  std::string place_;
};

class Link : public ::testing::Test {
 protected:
  MavlinkLink link_to(const std::string& endpoint) {
    return {make_transport(parse_endpoint(endpoint)), kUs,
            Signing(SigningKey(Sha256::from_hex(kKeyHex)->bytes), time_, 1)};
  }
  // Until `done`, which looks after everything that arrived.
  template <class Done>
  static void go_on(MavlinkLink& link, Done done, const std::function<void(const ReceivedMessage&)>& handle) {
    const std::int64_t deadline_us = steady_us() + 60'000'000;
    while (!done()) {
      ASSERT_LT(steady_us(), deadline_us) << "the link is dead: " << link.transport().last_error();
      link.advance(steady_us(), handle);
      pollfd ready{link.transport().descriptor(), link.transport().events(), 0};
      ::poll(&ready, 1, 10);
    }
  }
  // One of each kind goes out until each was received; then the other end is asked to stop.
  static void converse(MavlinkLink& link, Peer& peer) {
    const std::vector<OutgoingMessage> messages{OwnHeartbeat{SystemState::active}, GpsInput{.fix = GpsFix::three_d},
                                                CommandAck{512, CommandResult::accepted, {1, 1}},
                                                ParameterRequest{{1, 1}, "GPS1_TYPE"}};
    std::set<std::string> answers;
    const auto handle = [&](const ReceivedMessage& received) {
      EXPECT_TRUE(received.is_signed);
      EXPECT_EQ(received.source, (MavlinkAddress{1, 1}));
      if (const auto* text = std::get_if<StatusText>(&received.message)) answers.insert(text->text);
      for (const OutgoingMessage& message : messages) link.send(message, received.monotonic_us);
    };
    go_on(
        link, [&] { return answers.size() == messages.size(); }, handle);
    EXPECT_TRUE(answers.contains("received GPS_INPUT"));
    const StatusText bye{TextSeverity::info, "bye", 0, 0};
    go_on(
        link,
        [&] {
          link.send(bye, steady_us());
          return peer.has_ended();
        },
        [](const ReceivedMessage&) {});
    const nlohmann::json report = peer.report();
    EXPECT_EQ(report["refused"], 0) << report;
    EXPECT_GE(report["received"]["GPS_INPUT"], 1);
    EXPECT_EQ(link.counts().frames.bad_crc, 0U);
    EXPECT_EQ(link.counts().signatures.wrong + link.counts().signatures.without, 0U);
  }

  test::TemporaryFolder folder_;
  SigningTime time_{folder_ / "time", system_us(), steady_us()};
};

TEST_F(Link, UdpWhereWeListen) {
  MavlinkLink link = link_to("udpin:127.0.0.1:0");
  link.advance(steady_us(), [](const ReceivedMessage&) {});
  EXPECT_FALSE(link.send(OwnHeartbeat{}, steady_us())) << "nobody has proved to be the autopilot";
  Peer peer("udp " + std::to_string(link.transport().local_port()));
  converse(link, peer);
}

TEST_F(Link, UdpWhereWeSendFirst) {
  Peer peer("udpbind");
  MavlinkLink link = link_to("udpout:127.0.0.1:" + peer.place());
  link.advance(steady_us(), [](const ReceivedMessage&) {});
  EXPECT_TRUE(link.send(OwnHeartbeat{}, steady_us()));
  converse(link, peer);
}

TEST_F(Link, TcpReconnects) {
  auto peer = std::make_unique<Peer>("tcp");
  const std::string port = peer->place();
  MavlinkLink link = link_to("tcp:127.0.0.1:" + port);
  converse(link, *peer);
  peer.reset();
  go_on(
      link, [&] { return link.counts().transport.lost == 1; }, [](const ReceivedMessage&) {});
  EXPECT_FALSE(link.send(OwnHeartbeat{}, steady_us()));
  Peer again("tcp " + port);
  converse(link, again);
  EXPECT_EQ(link.counts().transport.opened, 2U);
}

TEST_F(Link, SerialPortThatIsUnplugged) {
  auto peer = std::make_unique<Peer>("pty");
  MavlinkLink link = link_to("serial:" + peer->place() + ":921600");
  converse(link, *peer);
  peer.reset();
  go_on(
      link, [&] { return !link.transport().is_open(); }, [](const ReceivedMessage&) {});
  EXPECT_EQ(link.counts().transport.lost, 1U);
  EXPECT_NE(link.transport().last_error(), "");
}

TEST_F(Link, UnauthenticatedPeersAreIgnored) {
  MavlinkLink link = link_to("udpin:127.0.0.1:0");
  link.advance(steady_us(), [](const ReceivedMessage&) {});
  const std::string port = std::to_string(link.transport().local_port());
  Peer friendly("udp " + port);
  MavlinkLink foreign(make_transport(parse_endpoint("udpout:127.0.0.1:" + port)), {1, 1},
                      Signing(SigningKey(Sha256::from_hex(std::string(64, '6'))->bytes), time_, 1));
  MavlinkLink unsigned_one(make_transport(parse_endpoint("udpout:127.0.0.1:" + port)), {1, 1}, std::nullopt);
  int others = 0;
  for (MavlinkLink* other : {&foreign, &unsigned_one}) {
    other->advance(steady_us(), [](const ReceivedMessage&) {});
    other->send(StatusText{TextSeverity::info, "unknown", 0, 0}, steady_us());
  }
  go_on(
      link, [&] { return link.counts().signatures.wrong == 1 && link.counts().signatures.without == 1; },
      [&](const ReceivedMessage& received) {
        const auto* text = std::get_if<StatusText>(&received.message);
        others += text != nullptr && text->text == "unknown" ? 1 : 0;
      });
  EXPECT_EQ(others, 0);
  int answered = 0;
  link.send(OwnHeartbeat{}, steady_us());
  for (MavlinkLink* other : {&foreign, &unsigned_one}) {
    other->advance(steady_us(), [&](const ReceivedMessage&) { ++answered; });
    EXPECT_EQ(other->counts().transport.bytes_in, 0U);
  }
  go_on(
      link,
      [&] {
        link.send(StatusText{TextSeverity::info, "bye", 0, 0}, steady_us());
        return friendly.has_ended();
      },
      [](const ReceivedMessage&) {});
}

// nadird restarts in flight; the timestamps of its peer pass with its frames and not with time.
class RestartedLink : public Link, public ::testing::WithParamInterface<std::int64_t> {};  // our clock is behind, days
INSTANTIATE_TEST_SUITE_P(Clock, RestartedLink, ::testing::Values(0, 400));
TEST_P(RestartedLink, ReceivesAPeerWhoseTimestampsStandStill) {
  const auto clock_us = [] { return system_us() - GetParam() * 86'400 * 1'000'000; };
  const auto link_at = [&](const std::string& port, SigningTime& time, StreamTimestamps& streams) {
    MavlinkLink link(make_transport(parse_endpoint("udpin:127.0.0.1:" + port)), kUs,
                     Signing(SigningKey(Sha256::from_hex(kKeyHex)->bytes), time, 1, &streams), MavlinkAddress{1, 1});
    link.advance(steady_us(), [](const ReceivedMessage&) {});
    return link;
  };
  const auto until_received = [](MavlinkLink& link, SigningTime& time, int count) {
    int received = 0;
    std::int64_t saved_us = steady_us();
    go_on(
        link,
        [&] {
          if (steady_us() - saved_us > 1'000'000) time.save(saved_us = steady_us());  // as in flight
          return received >= count;
        },
        [&](const ReceivedMessage& message) {
          ++received;
          link.send(OwnHeartbeat{SystemState::active}, message.monotonic_us);
        });
  };
  std::optional<Peer> peer;
  std::string port;
  {
    SigningTime time(folder_ / "time", clock_us(), steady_us());
    StreamTimestamps streams(folder_ / "streams");
    MavlinkLink link = link_at("0", time, streams);
    port = std::to_string(link.transport().local_port());
    peer.emplace("udp " + port);
    until_received(link, time, 5);
    streams.save();
    time.save(steady_us());
  }
  SigningTime time(folder_ / "time", clock_us(), steady_us());
  StreamTimestamps streams(folder_ / "streams");
  MavlinkLink link = link_at(port, time, streams);
  until_received(link, time, 5);
  EXPECT_GT(link.counts().signatures.replayed, 0U) << "what was saved ahead counts as seen";
  const StatusText bye{TextSeverity::info, "bye", 0, 0};
  go_on(
      link,
      [&] {
        time.save(steady_us());
        link.send(bye, steady_us());
        return peer->has_ended();
      },
      [](const ReceivedMessage&) {});
  EXPECT_EQ(peer->report()["refused"], 0);
}

// The answer to a recording is a heartbeat: nothing follows it, and whoever played it is not the peer.
TEST_F(Link, ARecordingIsChallengedAndNotFollowed) {
  StreamTimestamps streams;
  MavlinkLink link(make_transport(parse_endpoint("udpin:127.0.0.1:0")), kUs,
                   Signing(SigningKey(Sha256::from_hex(kKeyHex)->bytes), time_, 1, &streams), MavlinkAddress{1, 1});
  link.advance(steady_us(), [](const ReceivedMessage&) {});
  const std::string endpoint = "udpout:127.0.0.1:" + std::to_string(link.transport().local_port());
  EXPECT_TRUE(streams.set({1, 1}, 7, signing_time_of(system_us()) + 60 * kSigningTicksPerSecond));
  SigningTime time(folder_ / "recorded", system_us(), steady_us());
  Signing recorder(SigningKey(Sha256::from_hex(kKeyHex)->bytes), time, 7);
  const Bytes recorded = recorder.sign(encode(OwnHeartbeat{}, {1, 1}, 0), steady_us());
  const auto player = make_transport(parse_endpoint(endpoint));
  FrameReader answers;
  std::uint64_t heartbeats = 0, others = 0;
  const std::int64_t deadline_us = steady_us() + 60'000'000;
  while (heartbeats < 3) {
    ASSERT_LT(steady_us(), deadline_us);
    player->advance(steady_us(), [&](const Transport::Arrival& arrival) { answers.add(arrival.bytes); });
    player->send(recorded);
    link.advance(steady_us(), [](const ReceivedMessage&) { ADD_FAILURE() << "a recording was accepted"; });
    link.send(GpsInput{.fix = GpsFix::three_d}, steady_us());
    while (const auto frame = answers.next()) {
      const auto message = decode(*frame);
      ASSERT_TRUE(message);
      ++(std::holds_alternative<Heartbeat>(*message) ? heartbeats : others);
    }
    pollfd ready{link.transport().descriptor(), link.transport().events(), 0};
    ::poll(&ready, 1, 10);
  }
  EXPECT_EQ(others, 0U);
  EXPECT_EQ(link.counts().messages, 0U);
  EXPECT_GE(link.counts().sent, heartbeats);
}

TEST_F(Link, AMissingPeerIsRetriedEverySecondWithoutBlocking) {
  MavlinkLink link = link_to("serial:/dev/no-such-port:57600");
  const auto nothing = [](const ReceivedMessage&) {};
  for (std::int64_t us = 0; us < 10'000'000; us += 10'000) link.advance(us, nothing);
  EXPECT_EQ(link.transport().descriptor(), -1);
  EXPECT_NE(link.transport().last_error().find("/dev/no-such-port"), std::string::npos);
  EXPECT_FALSE(link.send(OwnHeartbeat{}, 0));
  EXPECT_EQ(link.counts().transport.frames_dropped, 1U);
}

TEST_F(Link, APeerThatDoesNotReadCostsABoundedBuffer) {
  Peer peer("pty");
  auto transport = make_transport(parse_endpoint("serial:" + peer.place() + ":921600"));
  transport->advance(0, [](const Transport::Arrival&) {});
  ASSERT_TRUE(transport->is_open());
  const Bytes frame(200, 0);  // no frames at all: the other end reads as fast as it can, and answers nothing
  std::uint64_t sent = 0;
  for (int i = 0; i < 100'000 && transport->counts().frames_dropped == 0; ++i) {
    if (transport->send(frame)) ++sent;
  }
  EXPECT_LE(sent * frame.size() - transport->counts().bytes_out, 16U * 1024U);
  MavlinkLink link(std::move(transport), kUs, Signing(SigningKey(Sha256::from_hex(kKeyHex)->bytes), time_, 1));
  go_on(
      link,
      [&] {
        link.send(StatusText{TextSeverity::info, "bye", 0, 0}, steady_us());
        return peer.has_ended();
      },
      [](const ReceivedMessage&) {});
}

}  // namespace
}  // namespace nadir
