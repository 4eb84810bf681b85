#include "http/client.hpp"

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <cstdint>

namespace nadir {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;

constexpr std::uint64_t kLargestAnswer = 8 << 20;

class Call {
 public:
  explicit Call(http::request<http::empty_body> request) : request_(std::move(request)) {
    parser_.body_limit(kLargestAnswer);
  }

  // The error; none when parser() holds the answer.
  beast::error_code run(const std::string& host, const std::string& port, std::chrono::milliseconds timeout) {
    resolver_.async_resolve(host, port, [this](beast::error_code error, const auto& endpoints) {
      if (failed(error)) return;
      stream_.async_connect(endpoints, [this](beast::error_code refused, const auto&) {
        if (!failed(refused)) exchange();
      });
    });
    io_.run_for(timeout);
    return io_.stopped() ? error_ : beast::error_code(beast::error::timeout);
  }

  http::response<http::string_body>& answer() { return parser_.get(); }

 private:
  bool failed(beast::error_code error) {
    error_ = error;
    return static_cast<bool>(error);
  }
  void exchange() {
    http::async_write(stream_, request_, [this](beast::error_code error, std::size_t) {
      if (failed(error)) return;
      http::async_read(stream_, buffer_, parser_, [this](beast::error_code broken, std::size_t) { failed(broken); });
    });
  }

  http::request<http::empty_body> request_;
  asio::io_context io_{1};
  asio::ip::tcp::resolver resolver_{io_};
  beast::tcp_stream stream_{io_};
  beast::flat_buffer buffer_;
  http::response_parser<http::string_body> parser_;
  beast::error_code error_;
};

}  // namespace

std::variant<HttpAnswer, NoHttpAnswer> http_get(const HttpGet& get, std::chrono::milliseconds timeout) {
  http::request<http::empty_body> request{http::verb::get, get.path, 11};
  request.set(http::field::host, get.host + ":" + get.port);
  request.keep_alive(false);
  if (!get.bearer_token.empty()) request.set(http::field::authorization, "Bearer " + get.bearer_token);
  const bool bracketed = get.host.starts_with('[') && get.host.ends_with(']');
  Call call(std::move(request));
  if (const auto error = call.run(bracketed ? get.host.substr(1, get.host.size() - 2) : get.host, get.port, timeout)) {
    return NoHttpAnswer{error.message()};
  }
  auto& answer = call.answer();
  return HttpAnswer{.status = static_cast<int>(answer.result_int()), .body = std::move(answer.body())};
}

}  // namespace nadir
