#include "http/multipart.hpp"

#include <algorithm>
#include <utility>

#include "base/number_text.hpp"
#include "http/message.hpp"

namespace nadir {
namespace {

constexpr std::size_t kMaxBoundary = 70;  // RFC 2046
constexpr std::size_t kMaxPartHeader = 8 * 1024;

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

// A parameter of a header: NAME=TOKEN or NAME="TEXT", where \" is a quote. Browsers escape a quote in a name as %22.
std::optional<std::string> parameter(std::string_view header, std::string_view wanted) {
  std::size_t at = header.find(';');
  while (at != std::string_view::npos) {
    header.remove_prefix(at + 1);
    const std::size_t equals = header.find('=');
    if (equals == std::string_view::npos) return std::nullopt;
    const std::string name = lower_case(trimmed(header.substr(0, equals)));
    header.remove_prefix(equals + 1);
    std::string value;
    if (header.starts_with('"')) {
      std::size_t i = 1;
      for (; i < header.size() && header[i] != '"'; ++i) {
        if (header[i] == '\\' && i + 1 < header.size() && (header[i + 1] == '"' || header[i + 1] == '\\')) ++i;
        value += header[i];
      }
      if (i == header.size()) return std::nullopt;
      header.remove_prefix(i + 1);
    } else {
      value = std::string(trimmed(header.substr(0, header.find(';'))));
    }
    if (name == wanted) return value;
    at = header.find(';');
  }
  return std::nullopt;
}

bool read_part_header(std::string_view lines, BodyPart& part) {
  bool disposition = false;
  while (!lines.empty()) {
    const std::size_t end = lines.find("\r\n");
    const std::string_view line = lines.substr(0, end);
    lines.remove_prefix(end == std::string_view::npos ? lines.size() : end + 2);
    const std::size_t colon = line.find(':');
    if (colon == std::string_view::npos) return false;
    const std::string name = lower_case(line.substr(0, colon));
    const std::string_view value = trimmed(line.substr(colon + 1));
    if (name == "content-type") part.content_type = media_type(value);
    if (name != "content-disposition") continue;
    if (disposition || media_type(value) != "form-data") return false;
    disposition = true;
    const auto field = parameter(value, "name");
    if (!field) return false;
    part.name = *field;
    part.filename = parameter(value, "filename").value_or(std::string());
  }
  return disposition;
}

std::optional<std::string> decoded(std::string_view text) {
  std::string plain;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      plain += text[i];
      continue;
    }
    if (i + 2 >= text.size()) return std::nullopt;
    const auto value = whole_number<unsigned>(text.substr(i + 1, 2), 16);
    if (!value) return std::nullopt;
    plain += static_cast<char>(*value);
    i += 2;
  }
  return plain;
}

}  // namespace

std::optional<std::vector<BodyPart>> parse_multipart(std::string_view content_type, std::string_view body,
                                                     std::size_t most) {
  if (media_type(content_type) != "multipart/form-data") return std::nullopt;
  const auto boundary = parameter(content_type, "boundary");
  if (!boundary || boundary->empty() || boundary->size() > kMaxBoundary) return std::nullopt;
  const std::string first = "--" + *boundary, delimiter = "\r\n" + first;
  if (body.starts_with("\r\n")) body.remove_prefix(2);
  if (!body.starts_with(first)) return std::nullopt;
  body.remove_prefix(first.size());
  std::vector<BodyPart> parts;
  for (;;) {
    if (body.starts_with("--")) return parts;
    if (!body.starts_with("\r\n") || parts.size() >= most) return std::nullopt;
    body.remove_prefix(2);
    const std::size_t end_of_header = body.substr(0, kMaxPartHeader).find("\r\n\r\n");
    if (end_of_header == std::string_view::npos) return std::nullopt;
    BodyPart part;
    if (!read_part_header(body.substr(0, end_of_header), part)) return std::nullopt;
    body.remove_prefix(end_of_header + 4);
    const std::size_t end = body.find(delimiter);
    if (end == std::string_view::npos) return std::nullopt;
    part.bytes = body.substr(0, end);
    body.remove_prefix(end + delimiter.size());
    parts.push_back(std::move(part));
  }
}

std::optional<std::map<std::string, std::string>> parse_query(std::string_view target) {
  std::map<std::string, std::string> query;
  const std::size_t mark = target.find('?');
  if (mark == std::string_view::npos || mark + 1 == target.size()) return query;
  target.remove_prefix(mark + 1);
  while (!target.empty()) {
    const std::size_t end = std::min(target.find('&'), target.size());
    const std::string_view pair = target.substr(0, end);
    target.remove_prefix(std::min(end + 1, target.size()));
    const std::size_t equals = pair.find('=');
    if (equals == std::string_view::npos) return std::nullopt;
    std::string text(pair.substr(equals + 1));
    for (char& c : text) c = c == '+' ? ' ' : c;
    auto name = decoded(pair.substr(0, equals)), value = decoded(text);
    if (!name || !value || !query.emplace(*std::move(name), *std::move(value)).second) return std::nullopt;
  }
  return query;
}

std::optional<std::vector<std::string>> path_parts(std::string_view path) {
  std::vector<std::string> parts;
  while (path.starts_with('/')) {
    path.remove_prefix(1);
    const std::size_t end = std::min(path.find('/'), path.size());
    auto part = decoded(path.substr(0, end));
    if (!part || part->empty()) return std::nullopt;
    parts.push_back(*std::move(part));
    path.remove_prefix(end);
  }
  if (!path.empty()) return std::nullopt;
  return parts;
}

}  // namespace nadir
