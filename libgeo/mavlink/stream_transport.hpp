// Bytes in a row: TCP and serial ports differ in how they are opened. See transport.hpp.
#pragma once

#include "mavlink/descriptor.hpp"
#include "mavlink/transport.hpp"

namespace nadir {

class StreamTransport final : public Transport {
 public:
  explicit StreamTransport(Endpoint endpoint);

  void advance(std::int64_t monotonic_us, const Sink& sink) override;
  bool send(ByteView frame) override;
  bool is_open() const override { return fd_ && !connecting_; }
  int descriptor() const override { return fd_.get(); }
  short events() const override;

 private:
  void open(std::int64_t monotonic_us);
  void finish_connecting(std::int64_t monotonic_us, const Sink& sink);
  void write_queued(const Sink& sink);
  void lose(int error, const Sink& sink);

  Endpoint endpoint_;
  Descriptor fd_;
  bool connecting_ = false;
  std::int64_t connect_until_us_ = 0;
  std::int64_t retry_us_ = 0;
  Bytes queue_;
};

}  // namespace nadir
