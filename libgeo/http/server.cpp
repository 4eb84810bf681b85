#include "http/server.hpp"

#include <fmt/format.h>

#include <atomic>
#include <boost/asio/dispatch.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <list>
#include <sstream>
#include <thread>

#include "base/error.hpp"

namespace nadir {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using tcp = asio::ip::tcp;
using Parser = http::request_parser<http::string_body>;

// Read by other threads as well.
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

// What connections share, in the server's thread.
struct Shared {
  const HttpHandler& handler;
  const HttpLimits limits;
  Counts counts{};
  std::uint64_t ticks = 0;  // orders connections by when they became idle
};

std::string text_of(beast::string_view text) { return {text.data(), text.size()}; }

ApiRequest header_from(Parser& parser) {
  const http::request<http::string_body>& message = parser.get();
  ApiRequest request{.method = text_of(message.method_string()),
                     .target = text_of(message.target()),
                     .host = text_of(message[http::field::host]),
                     .authorization = text_of(message[http::field::authorization]),
                     .content_type = text_of(message[http::field::content_type])};
  for (const auto& field : message) {
    request.headers.emplace(lower_case(text_of(field.name_string())), text_of(field.value()));
  }
  if (const auto length = parser.content_length()) request.content_length = *length;
  request.other_encoding = parser.chunked() || request.header("transfer-encoding") != nullptr ||
                           request.header("content-encoding") != nullptr;
  return request;
}

// Errors of what was sent; the others are those of a connection that is gone or too slow.
bool is_protocol_error(beast::error_code error) {
  return error && error != http::error::end_of_stream && error != http::error::partial_message &&
         error.category() == http::make_error_code(http::error::bad_method).category();
}

Problem problem_from(beast::error_code error) {
  if (error == http::error::header_limit) {
    return {.status = 431, .type = "header-too-large", .detail = "the request header is too large"};
  }
  if (error == http::error::body_limit) {
    return {.status = 413, .type = "body-too-large", .detail = "the request body is too large"};
  }
  return {.status = 400, .type = "malformed", .detail = "not an HTTP/1.1 request: " + error.message()};
}

template <typename Message>
void fill(Message& message, const ApiResponse& from) {
  message.version(11);
  message.result(static_cast<unsigned>(from.status));
  if (from.status == 460) message.reason("Checksum Mismatch");
  if (!from.content_type.empty()) message.set(http::field::content_type, from.content_type);
  for (const auto& [name, value] : from.headers) message.set(name, value);
}

// One connection: header, body, response, and again; or a stream until one side closes. Runs in the server's thread.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(tcp::socket socket, Shared& shared)
      : stream_(std::move(socket)), timer_(stream_.get_executor()), shared_(shared), limits_(shared.limits) {
    ++shared_.counts.connections_open;
  }
  ~Connection() {
    if (stream_text_) --shared_.counts.streams_open;
    --shared_.counts.connections_open;
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  // Since when it waits for its client: for a request, or to take a response; counted in events, not in seconds.
  std::uint64_t idle_since() const { return idle_since_; }
  bool busy() const { return busy_; }

  void read_header() {
    wait_for_client();
    head_ = false;
    parser_.emplace();
    parser_->header_limit(limits_.header_bytes);
    parser_->body_limit(limits_.body_bytes);
    stream_.expires_after(limits_.request_time);
    http::async_read_header(
        stream_, buffer_, *parser_,
        [self = shared_from_this()](beast::error_code error, std::size_t) { self->on_header(error); });
  }

  void close() {
    beast::error_code ignored;
    timer_.cancel();
    stream_.socket().shutdown(tcp::socket::shutdown_both, ignored);
    stream_.close();
  }

 private:
  void on_header(beast::error_code error) {
    if (failed(error)) return;
    request_ = header_from(*parser_);
    head_ = request_.method == "HEAD";
    auto admitted = shared_.handler.admit(request_);
    if (auto* refusal = std::get_if<ApiResponse>(&admitted)) {
      ++shared_.counts.requests_total;
      return send(std::move(*refusal), nothing_follows());
    }
    admission_ = std::move(std::get<std::shared_ptr<HttpAdmission>>(admitted));
    busy_ = admission_->busy;
    if (parser_->get()[http::field::expect] != "100-continue") return read_body();
    static constexpr std::string_view kContinue = "HTTP/1.1 100 Continue\r\n\r\n";
    asio::async_write(stream_, asio::buffer(kContinue.data(), kContinue.size()),
                      [self = shared_from_this()](beast::error_code broken, std::size_t) {
                        if (broken) return self->close();
                        self->read_body();
                      });
  }

  // Answers what is no HTTP, closes what is gone.
  bool failed(beast::error_code error) {
    if (is_protocol_error(error)) {
      ++shared_.counts.requests_total;
      send(answer(problem_from(error)), false);
    } else if (error) {
      close();
    }
    return static_cast<bool>(error);
  }

  // Without a body the connection stays usable after a refusal, if its client wants that.
  bool nothing_follows() const {
    return request_.content_length.value_or(0) == 0 && !request_.other_encoding && parser_->get().keep_alive();
  }

  void read_body() {
    if (limits_.body_time) {
      const auto size_time = std::chrono::seconds(admission_->body_bytes / limits_.slowest_bytes_s);
      stream_.expires_after(*limits_.body_time + size_time);
    }
    http::async_read(stream_, buffer_, *parser_, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (!self->failed(error)) self->serve();
    });
  }

  void serve() {
    stream_.expires_never();
    ++shared_.counts.requests_total;
    request_.body = std::move(parser_->get().body());
    const bool keep_alive = parser_->get().keep_alive();
    // The connection leaves the thread that answers with the response: it ends in this one.
    auto respond = [self = shared_from_this(), keep_alive](ApiResponse response) mutable {
      auto* const connection = self.get();
      asio::dispatch(connection->stream_.get_executor(),
                     [self = std::move(self), keep_alive, response = std::move(response)]() mutable {
                       self->send(std::move(response), keep_alive);
                     });
    };
    shared_.handler.serve(std::move(request_), *admission_, shared_.counts.now(), std::move(respond));
  }

  void wait_for_client() {
    busy_ = false;
    idle_since_ = ++shared_.ticks;
  }

  void send(ApiResponse from, bool keep_alive) {
    wait_for_client();
    request_ = {};
    if (from.stream && !head_) {
      if (shared_.counts.streams_open < limits_.streams) return start_stream(from);
      ++shared_.counts.streams_refused;
      from = answer({.status = 503, .type = "streams", .detail = "too many event streams are open; try again later"});
      keep_alive = false;
    }
    auto response = std::make_shared<http::response<http::string_body>>();
    fill(*response, from);
    response->keep_alive(keep_alive);
    response->body() = std::move(from.body);
    if (from.status != 204) response->prepare_payload();
    if (head_) response->body().clear();
    stream_.expires_after(limits_.answer_time);
    http::async_write(stream_, *response, [self = shared_from_this(), response](beast::error_code error, std::size_t) {
      self->admission_.reset();  // a response that is not taken still counts
      if (error) return self->close();
      if (response->keep_alive()) return self->read_header();
      self->stream_.socket().shutdown(tcp::socket::shutdown_send, error);
      self->stream_.expires_after(self->limits_.linger_time);
      self->drain();
    });
  }

  // Closing on a client that still sends would take the response away from it: what it sends is read and dropped first.
  void drain() {
    constexpr std::size_t kPiece = 4096;
    buffer_.clear();
    stream_.async_read_some(buffer_.prepare(kPiece), [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error) return self->close();
      self->drain();
    });
  }

  void start_stream(const ApiResponse& from) {
    ++shared_.counts.streams_open;
    busy_ = true;  // its reader is slow at its own risk (answer_time), and never evicted
    stream_text_ = from.stream;
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

  // A reader of a stream sends nothing more: input, or the end of it, closes the connection.
  void watch_for_the_end() {
    stream_.socket().async_wait(tcp::socket::wait_read,
                                [self = shared_from_this()](beast::error_code) { self->close(); });
  }

  void write_text() {
    stream_.expires_after(limits_.answer_time);
    asio::async_write(stream_, asio::buffer(text_), [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error == beast::error::timeout) ++self->shared_.counts.streams_dropped;
      if (error) return self->close();
      self->last_write_ = std::chrono::steady_clock::now();
      self->wait_for_text();
    });
  }

  void wait_for_text() {
    stream_.expires_never();
    timer_.expires_after(limits_.stream_interval);
    timer_.async_wait([self = shared_from_this()](beast::error_code error) {
      if (error || !self->stream_.socket().is_open()) return;
      try {
        self->text_ = self->stream_text_();
      } catch (const std::exception&) {
        return self->close();
      }
      if (self->text_.empty()) {
        const auto silent = std::chrono::steady_clock::now() - self->last_write_;
        if (silent < self->limits_.heartbeat) return self->wait_for_text();
        self->text_ = kStreamHeartbeat;
      }
      self->write_text();
    });
  }

  beast::tcp_stream stream_;
  asio::steady_timer timer_;
  Shared& shared_;
  const HttpLimits& limits_;
  beast::flat_buffer buffer_;
  std::optional<Parser> parser_;
  ApiRequest request_;
  std::shared_ptr<HttpAdmission> admission_;
  bool head_ = false;
  std::uint64_t idle_since_ = 0;
  bool busy_ = false;
  std::function<std::string()> stream_text_;  // set: this is a stream
  std::string text_;
  std::chrono::steady_clock::time_point last_write_;
};

}  // namespace

std::variant<std::shared_ptr<HttpAdmission>, ApiResponse> HttpHandler::admit(const ApiRequest&) const {
  return std::make_shared<HttpAdmission>();
}

struct HttpServer::Impl {
  Impl(const HttpHandler& handler, const ListenAddress& address, const HttpLimits& limits)
      : shared{.handler = handler, .limits = limits}, acceptor(io), retry(io) {
    listen(address);
    accept();
    thread = std::thread([this] {
      shared.handler.on_thread_start();
      run();
    });
  }

  ~Impl() {
    asio::post(io, [this] {
      boost::system::error_code ignored;
      acceptor.close(ignored);
      retry.cancel();
      for (const auto& weak : connections) {
        if (const auto connection = weak.lock()) connection->close();
      }
    });
    thread.join();
    shared.handler.on_stopped();
  }

  // Until there is nothing more to do. What a handler throws (out of memory, above all) ends what it was doing; it ends
  // neither other connections nor the program, which may have a flight to fly.
  void run() {
    for (;;) {
      try {
        io.run();
        return;
      } catch (const std::exception&) {
      }
    }
  }

  void listen(const ListenAddress& address) {
    try {
      const tcp::endpoint endpoint(asio::ip::make_address(address.ip), address.port);
      acceptor.open(endpoint.protocol());
      acceptor.set_option(tcp::acceptor::reuse_address(true));
      acceptor.bind(endpoint);
      acceptor.listen();
      port = acceptor.local_endpoint().port();
    } catch (const boost::system::system_error& error) {
      throw Error({.what = "the API cannot listen",
                   .where = fmt::format("{}:{}", address.ip, address.port),
                   .found = error.code().message(),
                   .fix = "choose another address or port, or stop the program that listens there"});
    }
  }

  void accept() {
    acceptor.async_accept([this](boost::system::error_code error, tcp::socket socket) {
      if (!acceptor.is_open()) return;
      if (error) return accept_later();  // out of file handles, perhaps: not in a busy loop
      accept();                          // first: whatever becomes of this one, the next may come
      take(std::move(socket));
    });
  }

  void accept_later() {
    retry.expires_after(std::chrono::milliseconds(100));
    retry.async_wait([this](boost::system::error_code error) {
      if (!error && acceptor.is_open()) accept();
    });
  }

  void take(tcp::socket socket) {
    ++shared.counts.connections_total;
    connections.remove_if([](const std::weak_ptr<Connection>& weak) { return weak.expired(); });
    if (connections.size() >= shared.limits.connections && !evict_idle()) {
      ++shared.counts.connections_refused;  // the socket closes here
      return;
    }
    beast::error_code ignored;
    socket.set_option(tcp::no_delay(true), ignored);
    const auto connection = std::make_shared<Connection>(std::move(socket), shared);
    connections.push_back(connection);
    connection->read_header();
  }

  // Closes the connection that has been idle for longest; false: all are busy.
  bool evict_idle() {
    std::shared_ptr<Connection> idle;
    for (const auto& weak : connections) {
      auto connection = weak.lock();
      if (!connection || connection->busy()) continue;
      if (!idle || connection->idle_since() < idle->idle_since()) idle = std::move(connection);
    }
    if (!idle) return false;
    idle->close();
    connections.remove_if([&idle](const std::weak_ptr<Connection>& weak) { return weak.lock() == idle; });
    return true;
  }

  Shared shared;
  asio::io_context io{1};
  std::list<std::weak_ptr<Connection>> connections;
  tcp::acceptor acceptor;
  asio::steady_timer retry;
  std::uint16_t port = 0;
  std::thread thread;
};

HttpServer::HttpServer(const HttpHandler& handler, const ListenAddress& address, const HttpLimits& limits)
    : impl_(std::make_unique<Impl>(handler, address, limits)) {}

HttpServer::~HttpServer() = default;

std::uint16_t HttpServer::port() const { return impl_->port; }
ServerCounts HttpServer::counts() const { return impl_->shared.counts.now(); }

}  // namespace nadir
