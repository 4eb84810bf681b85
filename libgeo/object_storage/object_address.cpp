#include "object_storage/object_address.hpp"

#include <curl/curl.h>

#include <algorithm>
#include <array>
#include <memory>

#include "base/error.hpp"
#include "base/printable.hpp"

namespace nadir {
namespace {

struct Spelling {
  std::string_view gdal, scheme;
  ObjectAddress::Store store;
};
constexpr std::array kSpellings = {Spelling{"/vsis3/", "s3://", ObjectAddress::Store::s3},
                                   Spelling{"/vsigs/", "gs://", ObjectAddress::Store::gs},
                                   Spelling{"/vsiaz/", "az://", ObjectAddress::Store::az}};
constexpr std::string_view kGdalWeb = "/vsicurl/";
constexpr std::size_t kLongest = 2048;

struct FreeUrl {
  void operator()(CURLU* url) const { curl_url_cleanup(url); }
};

// Whatever follows a query's or a fragment's beginning may be a signature.
std::string without_secrets(std::string_view text) {
  const std::size_t name = std::min(text.size(), text.find_first_of("?#"));
  return printable_url(text.substr(0, name)) + (name == text.size() ? "" : "?***");
}

[[noreturn]] void refuse(std::string_view text, std::string what, std::string expected, std::string fix = {}) {
  throw UsageError({.what = std::move(what),
                    .where = without_secrets(text),
                    .expected = std::move(expected),
                    .fix = std::move(fix)});
}

void refuse_credentials(std::string_view text, std::string_view rest) {
  if (rest.find_first_of("?#") == std::string_view::npos && rest.substr(0, rest.find('/')).find('@') == rest.npos)
    return;
  refuse(text, "the name of an object holds more than its name",
         "no user name, no query, no fragment: they would be written into lists and messages",
         "name the object alone; credentials belong into the environment or ~/.aws/credentials "
         "(docs/commands/cache-pin.md)");
}

bool has_control_characters(std::string_view text) {
  return std::any_of(text.begin(), text.end(),
                     [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; });
}

ObjectAddress in_store(std::string_view text, const Spelling& spelling, std::string_view rest) {
  refuse_credentials(text, rest);
  const std::size_t slash = rest.find('/');
  if (slash == std::string_view::npos || slash == 0 || slash + 1 == rest.size()) {
    refuse(text, "this names no object", std::string(spelling.scheme) + "BUCKET/KEY");
  }
  return {spelling.store, std::string(spelling.scheme) + std::string(rest), std::string(rest.substr(0, slash)),
          std::string(rest.substr(slash + 1))};
}

}  // namespace

bool is_remote_name(std::string_view name) {
  if (name.starts_with("/vsi")) return true;
  const std::size_t colon = name.find("://");
  return colon != std::string_view::npos && colon < 10;
}

ObjectAddress parse_object_address(std::string_view text) {
  if (text.size() > kLongest || has_control_characters(text)) {
    refuse(text.substr(0, 80), "this names no object", "a URL of at most 2048 characters, none of them invisible");
  }
  for (const Spelling& spelling : kSpellings) {
    for (const std::string_view prefix : {spelling.gdal, spelling.scheme}) {
      if (text.starts_with(prefix)) return in_store(text, spelling, text.substr(prefix.size()));
    }
  }
  const std::string_view web = text.starts_with(kGdalWeb) ? text.substr(kGdalWeb.size()) : text;
  for (const std::string_view scheme : {"https://", "http://"}) {
    if (!web.starts_with(scheme)) continue;
    refuse_credentials(text, web.substr(scheme.size()));
    const std::unique_ptr<CURLU, FreeUrl> url(curl_url());
    if (curl_url_set(url.get(), CURLUPART_URL, std::string(web).c_str(), CURLU_DISALLOW_USER) != CURLUE_OK ||
        web.find('/', scheme.size() + 1) == std::string_view::npos || web[scheme.size()] == '/') {
      refuse(text, "this names no file on a web server", std::string(scheme) + "HOST/PATH");
    }
    return {ObjectAddress::Store::web, std::string(web), {}, {}};
  }
  refuse(text, "imagery is not read from there", "s3://, gs://, az://, https:// or http://, or a file on this machine");
}

}  // namespace nadir
