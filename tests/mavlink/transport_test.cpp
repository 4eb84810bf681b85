#include "mavlink/transport.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"

namespace nadir {
namespace {

TEST(Endpoints, AreParsedAndFormatted) {
  for (const char* text : {"udpin:0.0.0.0:14550", "udpout:192.168.4.1:14550", "tcp:127.0.0.1:5760", "udpin:[::1]:0",
                           "serial:/dev/ttyAMA0:921600", "serial:/dev/serial/by-id/usb:1:57600"}) {
    EXPECT_EQ(to_string(parse_endpoint(text)), text);
  }
  const Endpoint tcp = parse_endpoint("tcp:localhost:5760");
  EXPECT_EQ(tcp, (Endpoint{.kind = Endpoint::Kind::tcp, .host = "127.0.0.1", .port = 5760}));
  EXPECT_EQ(parse_endpoint("udpin:[::1]:14550").host, "::1");
}

TEST(Endpoints, ErrorsSayWhatIsWrong) {
  const std::pair<const char*, const char*> wrong[] = {{"", "not an autopilot address"},
                                                       {"udpin", "not an autopilot address"},
                                                       {"udpin:14550", "not an autopilot address"},
                                                       {"usb:/dev/x:9600", "kind"},
                                                       {"udpin:autopilot:1", "host"},
                                                       {"udpin::14550", "host"},
                                                       {"tcp:1.2.3.4:0", "port"},
                                                       {"tcp:1.2.3.4:65536", "port"},
                                                       {"tcp:1.2.3.4:-1", "port"},
                                                       {"tcp:1.2.3.4:", "port"},
                                                       {"tcp:1.2.3.4:57x", "port"},
                                                       {"udpin:::1:14550", "colons"},
                                                       {"serial:ttyS0:9600", "path"},
                                                       {"serial:/dev/ttyS0:", "baud"},
                                                       {"serial:/dev/ttyS0:12345", "baud"}};
  for (const auto& [text, what] : wrong) {
    try {
      parse_endpoint(text);
      ADD_FAILURE() << text;
    } catch (const UsageError& error) {
      EXPECT_NE(error.text().what.find(what), std::string::npos) << text << ": " << error.what();
    }
  }
}

}  // namespace
}  // namespace nadir
