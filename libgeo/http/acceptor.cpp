#include "http/acceptor.hpp"

#include <fmt/format.h>

#include "base/error.hpp"

namespace nadir {

using tcp = boost::asio::ip::tcp;

Acceptor::Acceptor(boost::asio::io_context& io, const ListenAddress& address, Taker take)
    : take_(std::move(take)), acceptor_(io), retry_(io) {
  try {
    const tcp::endpoint endpoint(boost::asio::ip::make_address(address.ip), address.port);
    acceptor_.open(endpoint.protocol());
    acceptor_.set_option(tcp::acceptor::reuse_address(true));
    acceptor_.bind(endpoint);
    acceptor_.listen();
    port_ = acceptor_.local_endpoint().port();
  } catch (const boost::system::system_error& error) {
    throw Error({.what = "the API cannot listen",
                 .where = fmt::format("{}:{}", address.ip, address.port),
                 .found = error.code().message(),
                 .fix = "choose another address or port, or end what listens there"});
  }
  accept();
}

void Acceptor::close() {
  boost::system::error_code ignored;
  acceptor_.close(ignored);
  retry_.cancel();
}

void Acceptor::accept() {
  acceptor_.async_accept([this](boost::system::error_code error, tcp::socket socket) {
    if (!acceptor_.is_open()) return;
    if (error) return accept_later();  // out of file handles, perhaps: not in a busy loop
    accept();                          // first: whatever becomes of this one, the next may come
    take_(std::move(socket));
  });
}

void Acceptor::accept_later() {
  retry_.expires_after(std::chrono::milliseconds(100));
  retry_.async_wait([this](boost::system::error_code error) {
    if (!error && acceptor_.is_open()) accept();
  });
}

}  // namespace nadir
