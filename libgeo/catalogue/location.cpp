#include "catalogue/location.hpp"

#include <algorithm>
#include <cctype>

#include "base/error.hpp"
#include "base/printable.hpp"

namespace nadir {
namespace {

std::string lower(std::string_view text) {
  std::string result(text);
  std::transform(result.begin(), result.end(), result.begin(),
                 [](char c) { return static_cast<char>(std::tolower(static_cast<unsigned char>(c))); });
  return result;
}

// The end of a libpq value: quoted by ' with \ as escape, or up to the next blank.
std::size_t end_of_value(std::string_view text, std::size_t at) {
  const bool quoted = at < text.size() && text[at] == '\'';
  for (std::size_t i = quoted ? at + 1 : at; i < text.size(); ++i) {
    if (text[i] == '\\') {
      ++i;
    } else if (quoted ? text[i] == '\'' : std::isspace(static_cast<unsigned char>(text[i])) != 0) {
      return quoted ? i + 1 : i;
    }
  }
  return text.size();
}

void hide_password_setting(std::string& text) {
  constexpr std::string_view kName = "password";
  for (std::size_t at = lower(text).find(kName); at != std::string::npos; at = lower(text).find(kName, at + 1)) {
    std::size_t value = at + kName.size();
    const auto skip_blanks = [&] {
      while (value < text.size() && std::isspace(static_cast<unsigned char>(text[value])) != 0) ++value;
    };
    skip_blanks();
    if (value >= text.size() || text[value] != '=') continue;
    ++value;
    skip_blanks();
    const std::size_t uri_end = text.find('&', value);
    const std::size_t end = std::min(end_of_value(text, value), uri_end);
    text.replace(value, end - value, "***");
  }
}

void hide_password_in_uri(std::string& text) {
  const std::size_t scheme = text.find("://");
  if (scheme == std::string::npos) return;
  const std::size_t begin = scheme + 3;
  const std::size_t end = std::min(text.find_first_of("/?", begin), text.size());
  const std::size_t at = text.rfind('@', end);
  const std::size_t colon = text.find(':', begin);
  if (at == std::string::npos || at < begin || colon == std::string::npos || colon > at) return;
  text.replace(colon + 1, at - colon - 1, "***");
}

}  // namespace

CatalogueLocation parse_catalogue_location(const std::string& text) {
  const std::string start = lower(text.substr(0, 16));
  CatalogueLocation location{.kind = CatalogueLocation::Kind::file, .name = text, .shown = text};
  if (start.starts_with("pg:") || start.starts_with("postgresql://") || start.starts_with("postgres://")) {
    location.kind = CatalogueLocation::Kind::postgres;
    std::string shown = text;
    hide_password_in_uri(shown);
    hide_password_setting(shown);
    if (shown != text) {
      throw UsageError(
          {.what = "a password must not be on the command line, where every user of this machine reads it",
           .where = printable(shown),
           .expected = "a location without a password",
           .fix = "keep it in ~/.pgpass (mode 0600), or in the file that PGPASSFILE names, and change the one "
                  "that was shown"});
    }
  } else if (text.empty() || start.starts_with("/vsi")) {
    throw UsageError({.what = "invalid catalogue location",
                      .where = printable(text),
                      .expected = "a file on this machine, or \"PG:dbname=… host=…\"",
                      .found = text.empty() ? "nothing" : "a virtual file system of GDAL"});
  }
  location.shown = printable(location.shown);
  return location;
}

}  // namespace nadir
