#include "upload/transport.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <exception>

#include "base/error.hpp"
#include "base/printable.hpp"
#include "http/curl.hpp"

namespace nadir {

namespace {

constexpr std::size_t kLargestHead = 1U << 16;  // bytes of all header lines

struct FreeUrl {
  void operator()(CURLU* url) const { curl_url_cleanup(url); }
};
struct FreeList {
  void operator()(curl_slist* list) const { curl_slist_free_all(list); }
};

// How fast the body goes out and then the reply comes in. libcurl's own limit knows a single rate, below which nothing
// moves for a while: a reply of two bytes a second is above every rate that a slow line needs.
class TransferRate {
 public:
  TransferRate(std::uint64_t body_bytes, std::uint64_t slowest_bytes_s, std::chrono::seconds allowance)
      : body_bytes_(body_bytes), slowest_bytes_s_(slowest_bytes_s), allowance_(allowance) {}

  // False once what has moved since the phase began is more than the allowance behind the slowest rate.
  bool keeps_up(std::uint64_t sent, std::uint64_t received) {
    const auto now = std::chrono::steady_clock::now();
    if (sent == 0 && received == 0) began_ = now;  // not connected yet, or not asked: other limits hold
    if (!replying_ && sent >= body_bytes_ && received > 0) replying_ = true, began_ = now;
    const std::uint64_t moved = replying_ ? received : sent;
    return now - began_ <= allowance_ + std::chrono::seconds(moved / slowest_bytes_s_);
  }

 private:
  const std::uint64_t body_bytes_, slowest_bytes_s_;
  const std::chrono::seconds allowance_;
  bool replying_ = false;
  std::chrono::steady_clock::time_point began_ = std::chrono::steady_clock::now();
};

// One request under way.
struct Exchange {
  ByteView unsent;
  std::uint64_t largest_reply = 0;
  std::size_t head_size = 0;
  bool too_large = false;
  HttpReply reply;
  const std::function<void()>* check = nullptr;
  std::exception_ptr stopped;
  TransferRate* rate = nullptr;
  bool too_slow = false;
};

std::size_t send_body(char* target, std::size_t size, std::size_t count, void* user) {
  auto& exchange = *static_cast<Exchange*>(user);
  const std::size_t bytes = std::min(size * count, exchange.unsent.size());
  std::copy_n(exchange.unsent.begin(), bytes, target);
  exchange.unsent = exchange.unsent.subspan(bytes);
  return bytes;
}

std::size_t take_body(char* data, std::size_t size, std::size_t count, void* user) {
  auto& exchange = *static_cast<Exchange*>(user);
  if (exchange.reply.body.size() + size * count > exchange.largest_reply) {
    exchange.too_large = true;
    return 0;
  }
  exchange.reply.body.append(data, size * count);
  return size * count;
}

std::size_t take_header(char* data, std::size_t size, std::size_t count, void* user) {
  auto& exchange = *static_cast<Exchange*>(user);
  std::string_view line(data, size * count);
  exchange.head_size += line.size();
  if (exchange.head_size > kLargestHead) {
    exchange.too_large = true;
    return 0;
  }
  if (line.starts_with("HTTP/")) exchange.reply.headers.clear();  // after 100 Continue comes the answer itself
  add_header_line(line, exchange.reply.headers);
  return size * count;
}

int look_around(void* user, curl_off_t, curl_off_t received, curl_off_t, curl_off_t sent) {
  auto& exchange = *static_cast<Exchange*>(user);
  try {
    (*exchange.check)();
    exchange.too_slow =
        !exchange.rate->keeps_up(static_cast<std::uint64_t>(sent), static_cast<std::uint64_t>(received));
    return exchange.too_slow ? 1 : 0;
  } catch (...) {
    exchange.stopped = std::current_exception();
    return 1;
  }
}

std::string url_part(CURLU* url, CURLUPart part) {
  char* text = nullptr;
  if (curl_url_get(url, part, &text, 0) != CURLUE_OK) return {};
  const std::string result = text;
  curl_free(text);
  return result;
}

bool secure(const std::string& address) {
  const std::unique_ptr<CURLU, FreeUrl> url(curl_url());
  return curl_url_set(url.get(), CURLUPART_URL, address.c_str(), 0) == CURLUE_OK &&
         url_part(url.get(), CURLUPART_SCHEME) == "https";
}

}  // namespace

std::string checked_service_address(std::string_view text) {
  const std::unique_ptr<CURLU, FreeUrl> url(curl_url());
  std::string address(text);
  while (address.ends_with('/')) address.pop_back();
  const bool parses = curl_url_set(url.get(), CURLUPART_URL, address.c_str(), CURLU_DISALLOW_USER) == CURLUE_OK;
  const std::string scheme = parses ? url_part(url.get(), CURLUPART_SCHEME) : "";
  const std::string host = url_part(url.get(), CURLUPART_HOST);
  const bool here = host == "localhost" || host == "127.0.0.1" || host == "[::1]";
  const bool plain = url_part(url.get(), CURLUPART_QUERY).empty() && url_part(url.get(), CURLUPART_FRAGMENT).empty();
  if (!parses || !plain || !(scheme == "https" || (scheme == "http" && here))) {
    throw UsageError({.what = "cannot use this address of a candidate service",
                      .expected = "https://HOST[:PORT][/PATH]; http:// only to localhost",
                      .found = printable_url(text),
                      .fix = "the token must not go over a wire in the clear; keep it in a file, not in the address"});
  }
  return address;
}

CurlTransport::CurlTransport(CurlSettings settings, std::function<void()> check)
    : settings_(std::move(settings)), check_(std::move(check)), handle_(std::make_unique<CurlHandle>()) {}

CurlTransport::~CurlTransport() = default;

HttpResult CurlTransport::exchange(const HttpRequest& request) {
  CURL* easy = handle_->easy;
  curl_easy_reset(easy);  // keeps the connection
  Exchange exchange;
  exchange.unsent = request.body;
  exchange.largest_reply = settings_.largest_reply;
  exchange.check = &check_;
  TransferRate rate(request.body.size(), settings_.slowest_bytes_s, std::chrono::seconds(settings_.stall_timeout_s));
  exchange.rate = &rate;
  set_option(easy, CURLOPT_URL, (settings_.address + request.path).c_str());
  set_option(easy, CURLOPT_PROTOCOLS_STR, "http,https");
  // Only to this machine itself: a proxy of the environment would get the token over a wire in the clear.
  if (!secure(settings_.address)) set_option(easy, CURLOPT_PROXY, "");
  set_option(easy, CURLOPT_FOLLOWLOCATION, 0L);
  set_option(easy, CURLOPT_HTTP_VERSION, static_cast<long>(CURL_HTTP_VERSION_1_1));
  set_option(easy, CURLOPT_SSLVERSION, static_cast<long>(CURL_SSLVERSION_TLSv1_2));
  set_option(easy, CURLOPT_SSL_VERIFYPEER, 1L);
  set_option(easy, CURLOPT_SSL_VERIFYHOST, 2L);
  if (settings_.authorities) set_option(easy, CURLOPT_CAINFO, settings_.authorities->c_str());
  set_option(easy, CURLOPT_NOSIGNAL, 1L);
  set_option(easy, CURLOPT_CONNECTTIMEOUT, static_cast<long>(settings_.connect_timeout_s));
  set_option(easy, CURLOPT_LOW_SPEED_LIMIT, 1L);
  set_option(easy, CURLOPT_LOW_SPEED_TIME, static_cast<long>(settings_.stall_timeout_s));
  set_option(easy, CURLOPT_TIMEOUT, static_cast<long>(settings_.request_timeout_s));
  set_option(easy, CURLOPT_USERAGENT, "nadir-sync/1");
  set_option(easy, CURLOPT_NOPROGRESS, 0L);
  set_option(easy, CURLOPT_XFERINFOFUNCTION, &look_around);
  set_option(easy, CURLOPT_XFERINFODATA, &exchange);
  set_option(easy, CURLOPT_HEADERFUNCTION, &take_header);
  set_option(easy, CURLOPT_HEADERDATA, &exchange);
  set_option(easy, CURLOPT_WRITEFUNCTION, &take_body);
  set_option(easy, CURLOPT_WRITEDATA, &exchange);

  if (request.method == "HEAD") {
    set_option(easy, CURLOPT_NOBODY, 1L);
  } else if (request.method != "GET") {
    // Without a way to rewind: when a line breaks, libcurl must not send the body again by itself. What follows is the
    // uploader's to decide.
    set_option(easy, CURLOPT_UPLOAD, 1L);
    set_option(easy, CURLOPT_INFILESIZE_LARGE, static_cast<curl_off_t>(request.body.size()));
    set_option(easy, CURLOPT_READFUNCTION, &send_body);
    set_option(easy, CURLOPT_READDATA, &exchange);
    set_option(easy, CURLOPT_CUSTOMREQUEST, request.method.c_str());
  }
  curl_slist* lines = curl_slist_append(nullptr, "Expect:");  // no round trip before a body
  lines = curl_slist_append(lines, ("Authorization: Bearer " + settings_.token).c_str());
  for (const auto& [name, value] : request.headers) lines = curl_slist_append(lines, (name + ": " + value).c_str());
  const std::unique_ptr<curl_slist, FreeList> owned(lines);
  set_option(easy, CURLOPT_HTTPHEADER, lines);

  const CURLcode code = curl_easy_perform(easy);
  if (exchange.stopped) std::rethrow_exception(exchange.stopped);
  if (exchange.too_large) return NoReply{fmt::format("an answer of more than {} bytes", settings_.largest_reply)};
  if (exchange.too_slow) {
    return NoReply{
        fmt::format("slower than {} bytes/s for {} s", settings_.slowest_bytes_s, settings_.stall_timeout_s)};
  }
  if (code == CURLE_SEND_FAIL_REWIND) return NoReply{"the connection was lost"};
  if (code != CURLE_OK) return NoReply{curl_easy_strerror(code)};
  long status = 0;
  curl_easy_getinfo(easy, CURLINFO_RESPONSE_CODE, &status);
  exchange.reply.status = static_cast<int>(status);
  return std::move(exchange.reply);
}

}  // namespace nadir
