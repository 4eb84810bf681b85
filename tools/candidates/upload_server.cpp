#include "candidates/upload_server.hpp"

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <limits>
#include <list>
#include <thread>

#include "candidates/upload_api.hpp"
#include "http/server.hpp"

namespace nadir {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using tcp = asio::ip::tcp;
using Parser = http::request_parser<http::string_body>;

std::string text_of(beast::string_view text) { return {text.data(), text.size()}; }

UploadRequest header_from(Parser& parser) {
  const http::request<http::string_body>& message = parser.get();
  const auto field = [&message](auto name) { return text_of(message[name]); };
  const auto optional_field = [&message](const char* name) -> std::optional<std::string> {
    const auto found = message.find(name);
    return found == message.end() ? std::nullopt : std::optional(text_of(found->value()));
  };
  UploadRequest request{.method = text_of(message.method_string()),
                        .target = text_of(message.target()),
                        .host = field(http::field::host),
                        .authorization = field(http::field::authorization),
                        .content_type = field(http::field::content_type)};
  if (const auto length = parser.content_length()) request.content_length = *length;
  request.other_encoding = parser.chunked() || message.count(http::field::transfer_encoding) > 0 ||
                           message.count(http::field::content_encoding) > 0;
  request.idempotency_key = optional_field("Idempotency-Key");
  request.upload_offset = optional_field("Upload-Offset");
  request.upload_length = optional_field("Upload-Length");
  request.content_digest = optional_field("Content-Digest");
  return request;
}

ApiResponse answer_to(beast::error_code error) {
  if (error == http::error::header_limit) {
    return answer({.status = 431, .type = "header-too-large", .detail = "the request's header is too large"});
  }
  return answer({.status = 400, .type = "malformed", .detail = "this is no HTTP/1.1 request: " + error.message()});
}

bool of_http(beast::error_code error) {
  return error && error != http::error::end_of_stream && error != http::error::partial_message &&
         error.category() == http::make_error_code(http::error::bad_method).category();
}

// What connections share. All of it is used in the server's thread alone.
struct Shared {
  Shared(const UploadApi& served, FairQueue& work, const UploadServerLimits& bounds)
      : api(served), queue(work), limits(bounds), shares(bounds.shares) {}

  const UploadApi& api;
  FairQueue& queue;
  const UploadServerLimits limits;
  ClientShares shares;
  std::uint64_t clock = 0;  // counts what happens, to tell who was silent for longest
};

// One connection: header, body, work, answer, and so on.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(tcp::socket socket, Shared& shared) : stream_(std::move(socket)), shared_(shared) {}
  ~Connection() { give_back(); }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  // Since when it has been waiting for its caller: for a request, or to take an answer.
  std::uint64_t silent_since() const { return silent_since_; }
  bool at_work() const { return at_work_; }

  void read_header() {
    wait_for_caller();
    parser_.emplace();
    parser_->header_limit(shared_.limits.header_bytes);
    parser_->body_limit(std::numeric_limits<std::uint64_t>::max());  // admit() decides, before a byte is read
    stream_.expires_after(shared_.limits.header_time);
    http::async_read_header(
        stream_, buffer_, *parser_,
        [self = shared_from_this()](beast::error_code error, std::size_t) { self->on_header(error); });
  }

  void close() {
    beast::error_code ignored;
    stream_.socket().shutdown(tcp::socket::shutdown_both, ignored);
    stream_.close();
  }

 private:
  void on_header(beast::error_code error) {
    if (of_http(error)) return send(answer_to(error), false);
    if (error) return close();
    request_ = header_from(*parser_);
    auto admitted = shared_.api.admit(request_);
    if (auto* refusal = std::get_if<ApiResponse>(&admitted)) return send(std::move(*refusal), nothing_follows());
    admission_ = std::move(std::get<Admission>(admitted));
    at_work_ = admission_.client != nullptr;
    if (admission_.client != nullptr) {
      if (!shared_.shares.take(admission_.client->name, admission_.body_bytes)) {
        return send(later(429, "too-many-requests", "too many requests at a time, or too large ones"),
                    nothing_follows());
      }
      has_share_ = true;
    }
    if (parser_->get()[http::field::expect] != "100-continue") return read_body();
    static constexpr std::string_view kContinue = "HTTP/1.1 100 Continue\r\n\r\n";
    asio::async_write(stream_, asio::buffer(kContinue.data(), kContinue.size()),
                      [self = shared_from_this()](beast::error_code failed, std::size_t) {
                        if (failed) return self->close();
                        self->read_body();
                      });
  }

  // Without a body the connection stays usable after a refusal, if its caller wants that.
  bool nothing_follows() const {
    return request_.content_length.value_or(0) == 0 && !request_.other_encoding && parser_->get().keep_alive();
  }

  void read_body() {
    const auto size_time = std::chrono::seconds(admission_.body_bytes / shared_.limits.slowest_bytes_s);
    stream_.expires_after(shared_.limits.body_time + size_time);
    http::async_read(stream_, buffer_, *parser_, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (of_http(error)) return self->send(answer_to(error), false);
      if (error) return self->close();
      self->work();
    });
  }

  void work() {
    stream_.expires_never();
    request_.body = std::move(parser_->get().body());
    const bool keep_alive = parser_->get().keep_alive();
    const std::string lane = admission_.client == nullptr ? "anybody" : "client " + admission_.client->name;
    const bool taken = shared_.queue.put(lane, [self = shared_from_this(), keep_alive] {
      auto response = std::make_shared<ApiResponse>(self->shared_.api.answer(self->admission_, self->request_));
      asio::post(self->stream_.get_executor(),
                 [self, response, keep_alive] { self->send(std::move(*response), keep_alive); });
    });
    if (!taken) send(later(429, "too-many-requests", "too many requests at a time"), keep_alive);
  }

  void wait_for_caller() {
    at_work_ = false;
    silent_since_ = ++shared_.clock;
  }

  void give_back() {
    if (has_share_) shared_.shares.give_back(admission_.client->name, admission_.body_bytes);
    has_share_ = false;
  }

  void send(ApiResponse from, bool keep_alive) {
    wait_for_caller();
    request_.body = {};
    auto response = std::make_shared<http::response<http::string_body>>();
    response->version(11);
    response->result(static_cast<unsigned>(from.status));
    if (from.status == 460) response->reason("Checksum Mismatch");
    if (!from.content_type.empty()) response->set(http::field::content_type, from.content_type);
    for (const auto& [name, value] : from.headers) response->set(name, value);
    response->keep_alive(keep_alive);
    const bool head = request_.method == "HEAD";
    response->body() = std::move(from.body);
    if (from.status != 204) response->prepare_payload();
    if (head) response->body().clear();
    stream_.expires_after(shared_.limits.answer_time);
    http::async_write(stream_, *response, [self = shared_from_this(), response](beast::error_code error, std::size_t) {
      self->give_back();  // an answer that nobody takes is its client's share
      if (error) return self->close();
      if (response->keep_alive()) return self->read_header();
      self->stream_.socket().shutdown(tcp::socket::shutdown_send, error);
      self->stream_.expires_after(self->shared_.limits.linger_time);
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

  beast::tcp_stream stream_;
  Shared& shared_;
  beast::flat_buffer buffer_;
  std::optional<Parser> parser_;
  UploadRequest request_;
  Admission admission_;
  bool has_share_ = false;  // of ClientShares
  std::uint64_t silent_since_ = 0;
  bool at_work_ = false;
};

}  // namespace

struct UploadServer::Impl {
  Impl(const UploadApi& api, FairQueue& queue, const ListenAddress& address, const UploadServerLimits& limits)
      : shared(api, queue, limits),
        acceptor(io, address, [this](tcp::socket socket) { take(std::move(socket)); }),
        thread([this] { serve_until_done(io); }) {}

  ~Impl() {
    asio::post(io, [this] {
      acceptor.close();
      for (const auto& weak : connections) {
        if (const auto connection = weak.lock()) connection->close();
      }
    });
    thread.join();
    shared.queue.stop();  // answers that are still being made have nobody to go to
  }

  void take(tcp::socket socket) {
    connections.remove_if([](const std::weak_ptr<Connection>& weak) { return weak.expired(); });
    if (connections.size() >= shared.limits.connections && !make_room()) return;  // the socket closes here
    beast::error_code ignored;
    socket.set_option(tcp::no_delay(true), ignored);
    const auto connection = std::make_shared<Connection>(std::move(socket), shared);
    connections.push_back(connection);
    connection->read_header();
  }

  // Closes the connection that has been silent for longest; false: all are at work.
  bool make_room() {
    std::shared_ptr<Connection> silent;
    for (const auto& weak : connections) {
      auto connection = weak.lock();
      if (!connection || connection->at_work()) continue;
      if (!silent || connection->silent_since() < silent->silent_since()) silent = std::move(connection);
    }
    if (!silent) return false;
    silent->close();
    connections.remove_if([&silent](const std::weak_ptr<Connection>& weak) { return weak.lock() == silent; });
    return true;
  }

  Shared shared;
  asio::io_context io{1};
  std::list<std::weak_ptr<Connection>> connections;
  Acceptor acceptor;
  std::thread thread;  // last: it uses all of the above
};

UploadServer::UploadServer(const UploadApi& api, FairQueue& queue, const ListenAddress& address,
                           const UploadServerLimits& limits)
    : impl_(std::make_unique<Impl>(api, queue, address, limits)) {}

UploadServer::~UploadServer() = default;

std::uint16_t UploadServer::port() const { return impl_->acceptor.port(); }

}  // namespace nadir
