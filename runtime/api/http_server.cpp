#include "api/http_server.hpp"

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <optional>
#include <set>
#include <sstream>
#include <thread>

#include "base/platform.hpp"
#include "http/acceptor.hpp"
#include "http/problem.hpp"
#include "http/serving.hpp"

namespace nadir {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using tcp = asio::ip::tcp;

struct Counts {
  std::atomic<std::uint64_t> connections_open{0}, connections_total{0}, connections_refused{0}, requests_total{0};
  std::atomic<std::uint64_t> streams_open{0}, streams_refused{0}, streams_dropped{0};

  ServerCounts now() const {
    return {.connections_open = connections_open,
            .connections_total = connections_total,
            .connections_refused = connections_refused,
            .requests_total = requests_total,
            .streams_open = streams_open,
            .streams_refused = streams_refused,
            .streams_dropped = streams_dropped};
  }
};

std::string text_of(beast::string_view text) { return {text.data(), text.size()}; }

ApiRequest request_from(const http::request<http::string_body>& message) {
  const auto field = [&](auto name) { return text_of(message[name]); };
  return {.method = text_of(message.method_string()),
          .target = text_of(message.target()),
          .host = field(http::field::host),
          .authorization = field(http::field::authorization),
          .content_type = field(http::field::content_type),
          .last_event_id = field("Last-Event-ID"),
          .body = message.body()};
}

Problem problem_of(beast::error_code error) {
  if (error == http::error::header_limit) {
    return {.status = 431, .type = "header-too-large", .detail = "the request's header is too large"};
  }
  if (error == http::error::body_limit) {
    return {.status = 413, .type = "body-too-large", .detail = "the request's body is too large"};
  }
  return {.status = 400, .type = "malformed", .detail = "this is no HTTP/1.1 request: " + error.message()};
}

// One connection: request, answer, and so on; or a stream until somebody leaves. Everything runs in the server's
// thread.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(tcp::socket socket, const Api& api, const HttpLimits& limits, Counts& counts)
      : stream_(std::move(socket)), timer_(stream_.get_executor()), api_(api), limits_(limits), counts_(counts) {
    ++counts_.connections_open;
  }
  ~Connection() {
    if (streaming_) --counts_.streams_open;
    --counts_.connections_open;
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  void read_request() {
    parser_.emplace();
    parser_->header_limit(limits_.header_bytes);
    parser_->body_limit(limits_.body_bytes);
    stream_.expires_after(limits_.request_time);
    http::async_read(stream_, buffer_, *parser_,
                     [self = shared_from_this()](beast::error_code error, std::size_t) { self->on_request(error); });
  }

  void close() {
    beast::error_code ignored;
    timer_.cancel();
    stream_.socket().shutdown(tcp::socket::shutdown_both, ignored);
    stream_.close();
  }

 private:
  void on_request(beast::error_code error) {
    const bool of_http = error.category() == http::make_error_code(http::error::bad_method).category();
    if (error == http::error::end_of_stream || error == http::error::partial_message || (error && !of_http)) {
      return close();
    }
    ++counts_.requests_total;
    if (error) return send(answer(problem_of(error)), false, false);

    const http::request<http::string_body>& message = parser_->get();
    const ApiRequest request = request_from(message);
    const ApiResponse response = api_.handle(request, counts_.now());
    const bool head = message.method() == http::verb::head;
    if (!response.stream || head) return send(response, head, message.keep_alive());
    if (counts_.streams_open >= limits_.streams) {
      ++counts_.streams_refused;
      return send(
          answer({.status = 503, .type = "streams", .detail = "too many event streams are open; try again later"}),
          false, false);
    }
    start_stream(response, cursor_from(request.last_event_id));
  }

  void send(const ApiResponse& from, bool head, bool keep_alive) {
    auto response = std::make_shared<http::response<http::string_body>>();
    fill(*response, from);
    response->keep_alive(keep_alive);
    response->body() = from.body;
    response->prepare_payload();
    if (head) response->body().clear();
    stream_.expires_after(limits_.answer_time);
    http::async_write(stream_, *response, [self = shared_from_this(), response](beast::error_code error, std::size_t) {
      if (error) return self->close();
      if (response->keep_alive()) return self->read_request();
      self->stream_.socket().shutdown(tcp::socket::shutdown_send, error);
      self->stream_.expires_after(self->limits_.linger_time);
      self->drain();
    });
  }

  // Closing on a client that still sends would take the answer away from it: what it sends is read and forgotten first.
  void drain() {
    constexpr std::size_t kPiece = 4096;
    buffer_.clear();
    stream_.async_read_some(buffer_.prepare(kPiece), [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error) return self->close();
      self->drain();
    });
  }

  template <typename Message>
  static void fill(Message& message, const ApiResponse& from) {
    message.version(11);
    message.result(static_cast<unsigned>(from.status));
    message.set(http::field::content_type, from.content_type);
    for (const auto& [name, value] : from.headers) message.set(name, value);
  }

  void start_stream(const ApiResponse& from, StreamCursor cursor) {
    streaming_ = true;
    ++counts_.streams_open;
    cursor_ = std::move(cursor);
    beast::error_code ignored;
    stream_.socket().set_option(asio::socket_base::send_buffer_size(limits_.stream_buffer_bytes), ignored);
    http::response<http::empty_body> header;
    fill(header, from);
    header.keep_alive(false);  // the stream's end is the connection's
    text_ = (std::ostringstream() << header.base()).str();
    text_ += kStreamHello;
    watch_for_the_end();
    write_text();
  }

  // A reader of a stream has nothing more to say: whatever comes is its end.
  void watch_for_the_end() {
    stream_.socket().async_wait(tcp::socket::wait_read,
                                [self = shared_from_this()](beast::error_code) { self->close(); });
  }

  void write_text() {
    stream_.expires_after(limits_.answer_time);
    asio::async_write(stream_, asio::buffer(text_), [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error == beast::error::timeout) ++self->counts_.streams_dropped;
      if (error) return self->close();
      self->last_write_ = std::chrono::steady_clock::now();
      self->wait_for_news();
    });
  }

  void wait_for_news() {
    stream_.expires_never();
    timer_.expires_after(limits_.stream_interval);
    timer_.async_wait([self = shared_from_this()](beast::error_code error) {
      if (error || !self->stream_.socket().is_open()) return;
      try {
        self->text_ = self->api_.next_of_stream(self->cursor_);
      } catch (const std::exception&) {
        return self->close();
      }
      if (self->text_.empty()) {
        if (std::chrono::steady_clock::now() - self->last_write_ < self->limits_.heartbeat)
          return self->wait_for_news();
        self->text_ = kStreamHeartbeat;
      }
      self->write_text();
    });
  }

  beast::tcp_stream stream_;
  asio::steady_timer timer_;
  const Api& api_;
  const HttpLimits& limits_;
  Counts& counts_;
  beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::string_body>> parser_;
  bool streaming_ = false;
  StreamCursor cursor_;
  std::string text_;
  std::chrono::steady_clock::time_point last_write_;
};

}  // namespace

struct HttpServer::Impl {
  Impl(const Api& served, const ListenAddress& address, const HttpLimits& bounds)
      : api(served),
        limits(bounds),
        acceptor(io, address, [this](tcp::socket socket) { take(std::move(socket)); }),
        thread([this] {
          begin_thread("api", ThreadPriority::low);
          serve_until_done(io);
        }) {}

  ~Impl() {
    asio::post(io, [this] {
      acceptor.close();
      for (const auto& weak : connections) {
        if (const auto connection = weak.lock()) connection->close();
      }
    });
    thread.join();
  }

  void take(tcp::socket socket) {
    ++counts.connections_total;
    if (counts.connections_open >= limits.connections) {
      ++counts.connections_refused;  // the socket closes here
      return;
    }
    const auto connection = std::make_shared<Connection>(std::move(socket), api, limits, counts);
    forget_the_gone();
    connections.insert(connection);
    connection->read_request();
  }

  void forget_the_gone() {
    std::erase_if(connections, [](const std::weak_ptr<Connection>& weak) { return weak.expired(); });
  }

  const Api& api;
  const HttpLimits limits;
  Counts counts;
  asio::io_context io{1};
  std::set<std::weak_ptr<Connection>, std::owner_less<>> connections;
  Acceptor acceptor;
  std::thread thread;  // last: it uses all of the above
};

HttpServer::HttpServer(const Api& api, const ListenAddress& address, const HttpLimits& limits)
    : impl_(std::make_unique<Impl>(api, address, limits)) {}

HttpServer::~HttpServer() = default;

std::uint16_t HttpServer::port() const { return impl_->acceptor.port(); }
ServerCounts HttpServer::counts() const { return impl_->counts.now(); }

}  // namespace nadir
