// Who may call: each token stands in a file of its own, whose name is the client's.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "candidates/service_result.hpp"

namespace nadir {

class Clients {
 public:
  // Each "FILE", for every airframe, or "AIRFRAME=FILE"; the same file may be given for several. Throws Error, and
  // UsageError where two clients would share a name or a token.
  explicit Clients(const std::vector<std::string>& token_files);

  const UploadClient* find(std::string_view authorization) const;  // null: nobody's
  std::size_t count() const { return clients_.size(); }

 private:
  std::map<Sha256, UploadClient> clients_;  // by the token's digest
};

}  // namespace nadir
