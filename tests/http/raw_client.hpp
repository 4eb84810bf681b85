// A TCP client that sends exactly the given bytes and reads only on request.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace nadir::test {

class RawClient {
 public:
  explicit RawClient(std::uint16_t port, int receive_buffer_bytes = 0);
  ~RawClient();
  RawClient(RawClient&& other) noexcept : fd_(other.fd_) { other.fd_ = -1; }
  RawClient& operator=(RawClient&&) = delete;

  bool send(std::string_view text);  // false: the connection is gone

  // Reads until the connection ends, `enough` has come, or nothing has come for as long as a test may take at all.
  std::string read_until(std::string_view enough);
  std::string read_to_the_end() { return read_until({}); }
  bool ended() const { return ended_; }

 private:
  int fd_ = -1;
  bool ended_ = false;
};

}  // namespace nadir::test
