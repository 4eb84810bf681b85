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
  UploadRequest request;
  request.method = line(), request.target = line();
  request.upload_offset = line(), request.upload_length = line(), request.content_digest = line();
  const auto way = way_of(request.target, request.method, 1 << 20);
  require(!way || request.target.starts_with("/v1/"), "a way beside the API");
  require(!way || way->admission.upload.find('/') == std::string::npos, "an upload's name that is a path");
  if (way) lists(way->methods, request.method);
  const auto header = part_header(request);
  if (const auto* part = std::get_if<PartHeader>(&header)) {
    require(!part->length || *part->length > 48, "a pack that holds no tile");
  }
  media_type(line());
}

}  // namespace nadir::fuzz
