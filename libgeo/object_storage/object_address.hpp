// The name of an object: a file in object storage, or on a web server.
//
//   s3://BUCKET/KEY   gs://BUCKET/KEY   az://CONTAINER/KEY   https://HOST/PATH   http://HOST/PATH
//
// GDAL's spellings are understood as well: /vsis3/BUCKET/KEY, /vsigs/, /vsiaz/, /vsicurl/https://HOST/PATH.
//
// A name is written into source lists, plans and messages, so it holds no credential: user names, queries (signed URLs)
// and fragments are refused. Who may read the object is the business of the environment.
#pragma once

#include <string>
#include <string_view>

namespace nadir {

struct ObjectAddress {
  enum class Store { s3, gs, az, web };

  Store store = Store::web;
  std::string url;        // the spelling above
  std::string container;  // bucket or container; empty on a web server
  std::string key;        // of the object in it

  auto operator<=>(const ObjectAddress&) const = default;
};

// Whether the text is meant as the name of something remote: it has a scheme, or one of GDAL's prefixes.
bool is_remote_name(std::string_view name);

// Throws UsageError for what is none of the above, and for names that hold credentials; the message does not repeat
// them.
ObjectAddress parse_object_address(std::string_view text);

}  // namespace nadir
