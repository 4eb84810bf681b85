// Bodies of several parts, as forms and scripts upload files: multipart/form-data (RFC 7578), and the query of a
// target. Views into the request: nothing is copied.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace nadir {

struct BodyPart {
  std::string name;      // of the form's field
  std::string filename;  // empty: none was sent. Never a path to be opened
  std::string content_type;
  std::string_view bytes;  // of the body
};

// nullopt for a body that is not made of parts as its Content-Type says, and for one with more than `most` parts.
std::optional<std::vector<BodyPart>> parse_multipart(std::string_view content_type, std::string_view body,
                                                     std::size_t most);

// "/v1/x?name=a%20b&n=3": the names and values after the '?', decoded. nullopt for a broken escape, a name that comes
// twice or a pair without '='.
std::optional<std::map<std::string, std::string>> parse_query(std::string_view target);

// "/v1/flights/a%20b": the parts between the slashes, decoded: "v1", "flights", "a b". nullopt for a broken escape and
// for an empty part.
std::optional<std::vector<std::string>> path_parts(std::string_view path);

}  // namespace nadir
