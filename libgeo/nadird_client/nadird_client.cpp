#include "nadird_client/nadird_client.hpp"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <optional>

#include "base/error.hpp"
#include "base/printable.hpp"

namespace nadir {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;

constexpr std::uint64_t kLargestAnswer = 8 << 20;
constexpr std::size_t kMostOfAProblemShown = 400;

// One request on a connection of its own, all of it within one time limit.
class Call {
 public:
  explicit Call(http::request<http::empty_body> request) : request_(std::move(request)) {
    parser_.body_limit(kLargestAnswer);
  }

  // The error; none when parser() holds the answer.
  beast::error_code run(const std::string& host, const std::string& port, std::chrono::milliseconds patience) {
    resolver_.async_resolve(host, port, [this](beast::error_code error, const auto& places) {
      if (failed(error)) return;
      stream_.async_connect(places, [this](beast::error_code refused, const auto&) {
        if (!failed(refused)) exchange();
      });
    });
    io_.run_for(patience);
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

NadirdClient::NadirdClient(std::string_view url, std::string token, std::chrono::milliseconds patience)
    : url_(url), token_(std::move(token)), patience_(patience) {
  constexpr std::string_view kScheme = "http://";
  std::string_view place = url;
  if (place.ends_with('/')) place.remove_suffix(1);
  if (place.starts_with(kScheme)) {
    place.remove_prefix(kScheme.size());
    const std::size_t colon = place.rfind(':');
    const bool has_port = colon != std::string_view::npos && place.find(']', colon) == std::string_view::npos;
    host_ = place.substr(0, has_port ? colon : place.size());
    port_ = has_port ? std::string(place.substr(colon + 1)) : "8750";
  }
  const auto all_of = [](const std::string& text, std::string_view allowed) {
    return !text.empty() && text.find_first_not_of(allowed) == std::string::npos;
  };
  if (!all_of(host_, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-_:[]") ||
      !all_of(port_, "0123456789")) {
    throw UsageError({.what = "the service's URL does not read",
                      .expected = fmt::format("http://HOST:PORT, as in {}", kDefaultServiceUrl),
                      .found = printable(url)});
  }
}

std::string NadirdClient::get(const std::string& path) const {
  http::request<http::empty_body> request{http::verb::get, path, 11};
  request.set(http::field::host, host_ + ":" + port_);
  request.keep_alive(false);
  if (!token_.empty()) request.set(http::field::authorization, "Bearer " + token_);
  const bool bracketed = host_.starts_with('[') && host_.ends_with(']');
  Call call(std::move(request));
  if (const auto error = call.run(bracketed ? host_.substr(1, host_.size() - 2) : host_, port_, patience_)) {
    throw Error({.what = "the service does not answer",
                 .where = url_ + path,
                 .found = printable(error.message()),
                 .fix = "start nadird, or name the address that it listens on"});
  }
  const int status = static_cast<int>(call.answer().result_int());
  if (status != 200) {
    throw Error(
        {.what = "the service refuses",
         .where = url_ + path,
         .expected = "200",
         .found = fmt::format("{}: {}", status, printable(call.answer().body().substr(0, kMostOfAProblemShown))),
         .fix = status == 401 ? "name the file with its token: --token-file FILE" : ""});
  }
  return std::move(call.answer().body());
}

}  // namespace nadir
