#include "object_storage/object_client.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <cstring>
#include <map>
#include <string_view>
#include <thread>

#include "base/error.hpp"
#include "base/printable.hpp"
#include "http/curl.hpp"

namespace nadir {

// One request and what became of it.
struct ObjectClient::Attempt {
  std::uint64_t most = 0;
  int status = 0;  // 0: no answer
  std::map<std::string, std::string> headers{};
  Bytes body{};
  std::string no_answer{};  // why
  std::string led_to{};     // an address that the server may not lead to
  std::size_t head_bytes = 0;
  bool too_large = false;

  std::string header(const char* name) const {
    const auto found = headers.find(name);
    return found == headers.end() ? std::string() : found->second;
  }
  bool worth_repeating() const {
    return led_to.empty() && !too_large && (status == 0 || status == 408 || status == 429 || status >= 500);
  }
};

namespace {

constexpr std::size_t kLargestHead = 1U << 16;
constexpr std::uint64_t kLargestComplaint = 1U << 16;  // bytes of an error's body that are read
constexpr long kMostRedirects = 5;

// Addresses at which nobody keeps imagery: of this link (169.254.169.254 hands a machine's credentials out), of no
// host, of many.
bool is_forbidden(const sockaddr& address) {
  std::array<std::uint8_t, 4> v4{};
  if (address.sa_family == AF_INET) {
    std::memcpy(v4.data(), &reinterpret_cast<const sockaddr_in&>(address).sin_addr, v4.size());
  } else if (address.sa_family == AF_INET6) {
    const in6_addr& v6 = reinterpret_cast<const sockaddr_in6&>(address).sin6_addr;
    static constexpr std::array<std::uint8_t, 16> kMetadata = {0xfd, 0x00, 0x0e, 0xc2, 0, 0, 0,    0,
                                                               0,    0,    0,    0,    0, 0, 0x02, 0x54};  // AWS
    if (IN6_IS_ADDR_LINKLOCAL(&v6) || IN6_IS_ADDR_MULTICAST(&v6) || IN6_IS_ADDR_UNSPECIFIED(&v6)) return true;
    if (std::memcmp(&v6, kMetadata.data(), kMetadata.size()) == 0) return true;
    if (!IN6_IS_ADDR_V4MAPPED(&v6)) return false;
    std::memcpy(v4.data(), &v6.s6_addr[12], v4.size());
  } else {
    return true;
  }
  return (v4[0] == 169 && v4[1] == 254) || v4[0] == 0 || v4[0] >= 224;
}

std::string text_of(const sockaddr& address) {
  std::array<char, INET6_ADDRSTRLEN> text{};
  const void* number = address.sa_family == AF_INET6
                           ? static_cast<const void*>(&reinterpret_cast<const sockaddr_in6&>(address).sin6_addr)
                           : static_cast<const void*>(&reinterpret_cast<const sockaddr_in&>(address).sin_addr);
  return inet_ntop(address.sa_family, number, text.data(), text.size()) == nullptr ? "no IP address" : text.data();
}

// Whatever a name resolves to, and wherever a redirection leads: this is the address itself.
curl_socket_t open_socket(void* user, curlsocktype, curl_sockaddr* address) {
  if (is_forbidden(address->addr)) {
    *static_cast<std::string*>(user) = text_of(address->addr);
    return CURL_SOCKET_BAD;
  }
  return ::socket(address->family, address->socktype | SOCK_CLOEXEC, address->protocol);
}

}  // namespace

std::optional<ContentRange> parse_content_range(std::string_view text) {
  constexpr std::string_view kUnit = "bytes ";
  if (!text.starts_with(kUnit)) return std::nullopt;
  text.remove_prefix(kUnit.size());
  ContentRange range;
  const auto take = [&text](std::uint64_t& value, std::string_view end) {
    const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);  // no sign, no space
    if (error != std::errc()) return false;
    text.remove_prefix(static_cast<std::size_t>(stop - text.data()));
    if (!text.starts_with(end)) return false;
    text.remove_prefix(end.size());
    return true;
  };
  if (!take(range.first, "-") || !take(range.last, "/") || !take(range.size, "") || !text.empty()) return std::nullopt;
  if (range.first > range.last || range.last >= range.size) return std::nullopt;
  return range;
}

namespace {

// <Tag>text</Tag> of the XML that object storage explains its refusals with.
std::string element(std::string_view xml, std::string_view tag) {
  const std::string open = fmt::format("<{}>", tag), close = fmt::format("</{}>", tag);
  const std::size_t begin = xml.find(open);
  if (begin == std::string_view::npos) return {};
  const std::size_t end = xml.find(close, begin);
  if (end == std::string_view::npos) return {};
  return printable(xml.substr(begin + open.size(), std::min<std::size_t>(end - begin - open.size(), 200)));
}

}  // namespace

ObjectClient::ObjectClient(SignUrl sign, ObjectClientSettings settings)
    : sign_(std::move(sign)), settings_(std::move(settings)) {}

ObjectClient::~ObjectClient() = default;

std::unique_ptr<CurlHandle> ObjectClient::take_connection() {
  const std::lock_guard lock(mutex_);
  if (idle_.empty()) return std::make_unique<CurlHandle>();
  std::unique_ptr<CurlHandle> connection = std::move(idle_.back());
  idle_.pop_back();
  return connection;
}

void ObjectClient::give_back(std::unique_ptr<CurlHandle> connection) {
  const std::lock_guard lock(mutex_);
  idle_.push_back(std::move(connection));
}

ObjectClient::Attempt ObjectClient::attempt(const ObjectAddress& object, std::uint64_t at, std::uint64_t most) {
  const bool web = object.store == ObjectAddress::Store::web;
  const std::string url = web ? object.url : sign_(object);
  const std::string range = fmt::format("{}-{}", at, at + most - 1);
  Attempt result;
  result.most = std::max(most, kLargestComplaint);

  std::unique_ptr<CurlHandle> connection = take_connection();
  CURL* easy = connection->easy;
  curl_easy_reset(easy);  // keeps the connection
  set_option(easy, CURLOPT_URL, url.c_str());
  set_option(easy, CURLOPT_RANGE, range.c_str());
  set_option(easy, CURLOPT_PROTOCOLS_STR, "http,https");
  set_option(easy, CURLOPT_FOLLOWLOCATION, web ? 1L : 0L);
  set_option(easy, CURLOPT_MAXREDIRS, kMostRedirects);
  set_option(easy, CURLOPT_REDIR_PROTOCOLS_STR, url.starts_with("https:") ? "https" : "http,https");
  set_option(easy, CURLOPT_OPENSOCKETFUNCTION, &open_socket);
  set_option(easy, CURLOPT_OPENSOCKETDATA, &result.led_to);
  set_option(easy, CURLOPT_HTTP_VERSION, static_cast<long>(CURL_HTTP_VERSION_1_1));
  set_option(easy, CURLOPT_SSLVERSION, static_cast<long>(CURL_SSLVERSION_TLSv1_2));
  if (settings_.authorities) set_option(easy, CURLOPT_CAINFO, settings_.authorities->c_str());
  set_option(easy, CURLOPT_NOSIGNAL, 1L);
  set_option(easy, CURLOPT_CONNECTTIMEOUT, static_cast<long>(settings_.connect_timeout_s));
  set_option(easy, CURLOPT_LOW_SPEED_LIMIT, static_cast<long>(settings_.slowest_bytes_s));
  set_option(easy, CURLOPT_LOW_SPEED_TIME, static_cast<long>(settings_.stall_timeout_s));
  set_option(easy, CURLOPT_TIMEOUT, static_cast<long>(settings_.request_timeout_s));
  set_option(easy, CURLOPT_USERAGENT, "nadir/1");
  set_option(
      easy, CURLOPT_HEADERFUNCTION, +[](char* data, std::size_t size, std::size_t count, void* user) -> std::size_t {
        auto& attempt = *static_cast<Attempt*>(user);
        std::string_view line(data, size * count);
        attempt.head_bytes += line.size();
        if (attempt.head_bytes > kLargestHead) {
          attempt.too_large = true;
          return 0;
        }
        if (line.starts_with("HTTP/")) attempt.headers.clear(), attempt.body.clear();  // of the redirection before
        add_header_line(line, attempt.headers);
        return size * count;
      });
  set_option(easy, CURLOPT_HEADERDATA, &result);
  set_option(
      easy, CURLOPT_WRITEFUNCTION, +[](char* data, std::size_t size, std::size_t count, void* user) -> std::size_t {
        auto& attempt = *static_cast<Attempt*>(user);
        if (attempt.body.size() + size * count > attempt.most) {
          attempt.too_large = true;
          return 0;
        }
        const auto* begin = reinterpret_cast<const std::uint8_t*>(data);
        attempt.body.insert(attempt.body.end(), begin, begin + size * count);
        return size * count;
      });
  set_option(easy, CURLOPT_WRITEDATA, &result);

  const CURLcode code = curl_easy_perform(easy);
  long status = 0;
  curl_easy_getinfo(easy, CURLINFO_RESPONSE_CODE, &status);
  ++requests_;
  bytes_ += result.body.size();
  if (code == CURLE_OK || result.too_large) result.status = static_cast<int>(status);
  if (code == CURLE_UNSUPPORTED_PROTOCOL || code == CURLE_TOO_MANY_REDIRECTS) {
    char* target = nullptr;
    curl_easy_getinfo(easy, CURLINFO_REDIRECT_URL, &target);
    result.led_to = target == nullptr ? result.header("location") : target;
    if (result.led_to.empty()) result.led_to = curl_easy_strerror(code);
  }
  result.no_answer = code == CURLE_OK ? "" : curl_easy_strerror(code);
  if (code == CURLE_OPERATION_TIMEDOUT) {
    result.no_answer += fmt::format(" (less than {} bytes/s for {} s, or longer than {} s)", settings_.slowest_bytes_s,
                                    settings_.stall_timeout_s, settings_.request_timeout_s);
  }
  give_back(std::move(connection));
  return result;
}

namespace {

const char* const kReach = "check the name, and the network and proxy settings of this machine";

std::string credentials_fix(const ObjectAddress& object) {
  switch (object.store) {
    case ObjectAddress::Store::s3:
      return "check AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE and ~/.aws/credentials, and that they "
             "may read it; AWS_NO_SIGN_REQUEST=YES for a public bucket";
    case ObjectAddress::Store::gs: return "check GS_ACCESS_KEY_ID and GS_SECRET_ACCESS_KEY, and that they may read it";
    case ObjectAddress::Store::az:
      return "check AZURE_STORAGE_ACCOUNT and AZURE_STORAGE_ACCESS_KEY, and that they may read it";
    case ObjectAddress::Store::web: break;
  }
  return "the web server must hand it out without a password";
}

}  // namespace

ObjectPart ObjectClient::read(const ObjectAddress& object, std::uint64_t at, std::uint64_t most) {
  Attempt answer;
  for (int count = 1, delay_ms = settings_.first_delay_ms;; ++count, delay_ms *= 2) {
    answer = attempt(object, at, most);
    if (!answer.worth_repeating() || count >= settings_.attempts) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(delay_ms));
  }
  const auto fail = [&object](std::string what, std::string expected, std::string found, std::string fix) {
    throw Error({.what = std::move(what),
                 .where = object.url,
                 .expected = std::move(expected),
                 .found = printable(found),
                 .fix = std::move(fix)});
  };
  const std::string_view text(reinterpret_cast<const char*>(answer.body.data()), answer.body.size());
  const std::string reason = element(text, "Code");
  const auto said = [&] {
    return fmt::format("{}{}", answer.status, reason.empty() ? "" : fmt::format(" ({})", reason));
  };
  const std::string region =
      answer.header("x-amz-bucket-region").empty() ? element(text, "Region") : answer.header("x-amz-bucket-region");

  if (!answer.led_to.empty()) {
    fail("an object's server leads to where imagery is not read from",
         "http or https, not from https to http, and no link-local address", answer.led_to,
         "do not use this server; or name the place where the object really lies");
  }
  if (answer.status == 0) fail("an object cannot be read", "an answer of its server", answer.no_answer, kReach);
  if (object.store != ObjectAddress::Store::web && !region.empty() &&
      (answer.status == 301 || answer.status == 307 || answer.status == 400)) {
    fail("the bucket lies in another region", "the region that AWS_REGION or ~/.aws/config names", region,
         "export AWS_REGION=" + region);
  }
  if (answer.status == 404) fail("there is no such object", "", said(), "check the name; it may have been removed");
  if (answer.status == 401 || answer.status == 403) {
    fail("an object may not be read", "permission to get it", said(), credentials_fix(object));
  }
  if (answer.status == 416) {
    fail("an object is shorter than it should be", fmt::format("more than {} bytes", at), said(),
         "pin it again, if the new one is wanted: nadir cache pin");
  }
  if (answer.status == 200 && (at > 0 || answer.too_large)) {
    fail("an object's server sends no parts of it", "206 Partial Content", said(),
         "keep it on a server that knows ranges (RFC 9110)");
  }
  if (answer.status != 206 && answer.status != 200) {
    fail("an object cannot be read", "206 Partial Content", said(), kReach);
  }

  ObjectPart part{std::move(answer.body), 0, answer.header("etag")};
  if (answer.status == 200) {
    part.object_bytes = part.bytes.size();
    return part;
  }
  const auto range = parse_content_range(answer.header("content-range"));
  const std::uint64_t wanted = range && range->size > at ? std::min(most, range->size - at) : 0;
  if (!range || range->first != at || range->last + 1 != at + wanted || part.bytes.size() != wanted || wanted == 0) {
    fail("an object's server sends another part than it was asked for", fmt::format("bytes {}-{}", at, at + most - 1),
         fmt::format("{} bytes, as \"{}\"", part.bytes.size(), answer.header("content-range")),
         "keep it on a server that knows ranges (RFC 9110)");
  }
  part.object_bytes = range->size;
  return part;
}

}  // namespace nadir
