// What anybody may send to the candidate service before a token is looked at: path, method, headers.
#include "candidates/upload_api.hpp"
#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"

namespace nadir::fuzz {

// Lines: method, path, Upload-Offset, Upload-Length, Content-Digest, Content-Type.
void upload_request(std::string_view bytes) {
  const auto line = [&bytes] {
    const std::size_t end = std::min(bytes.find('\n'), bytes.size());
    std::string text(bytes.substr(0, end));
    bytes.remove_prefix(std::min(end + 1, bytes.size()));
    return text;
  };
  ApiRequest request;
  request.method = line(), request.target = line();
  for (const char* name : {"upload-offset", "upload-length", "content-digest"}) request.headers[name] = line();
  const auto route = upload_route(request.target, request.method, 1 << 20);
  require(!route || request.target.starts_with("/v1/"), "a path outside of the API");
  require(!route || route->admission.upload.find('/') == std::string::npos, "an upload's name that is a path");
  if (route) route->allows(request.method);
  const auto header = part_header(request);
  if (const auto* part = std::get_if<PartHeader>(&header)) {
    require(!part->length || *part->length > 48, "a pack that holds no tile");
  }
  media_type(line());
}

}  // namespace nadir::fuzz
