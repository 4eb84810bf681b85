// Listens on an address and hands over each connection that comes, in the thread that runs the io_context.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cstdint>
#include <functional>

#include "http/listen.hpp"

namespace nadir {

class Acceptor {
 public:
  using Taker = std::function<void(boost::asio::ip::tcp::socket)>;

  // Listens at once. Throws Error when the address cannot be had.
  Acceptor(boost::asio::io_context& io, const ListenAddress& address, Taker take);

  void close();  // in the thread that runs the io_context
  std::uint16_t port() const { return port_; }

 private:
  void accept();
  void accept_later();

  Taker take_;
  boost::asio::ip::tcp::acceptor acceptor_;
  boost::asio::steady_timer retry_;
  std::uint16_t port_ = 0;
};

}  // namespace nadir
