// The members of a JSON object from outside, for documents in which each member must be there, of its type and within
// its range, and no other may be. Whatever is not so is an Error that says where, what was expected and what was found.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

#include "base/sha256.hpp"

namespace nadir {

class JsonMembers {
 public:
  // What every Error of a document says.
  struct Complaint {
    const char* what = "";  // "cannot accept these poses"
    const char* fix = "";
  };

  // where: the document, or a place in it. As many members as are read in the end: then none is unknown. The object
  // must outlive this.
  JsonMembers(const nlohmann::json& object, std::string where, std::size_t members, const Complaint& complaint);

  const std::string& where() const { return where_; }
  const nlohmann::json& member(const char* key) const;
  JsonMembers object(const char* key, std::size_t members) const;
  const std::string& text(const char* key) const;
  double number(const char* key, double least, double most) const;
  std::int64_t whole(const char* key, std::int64_t least, std::int64_t most) const;
  bool yes_or_no(const char* key) const;
  Sha256 digest(const char* key) const;

  [[noreturn]] void refuse(std::string_view member, std::string expected, const nlohmann::json& found) const;

 private:
  const nlohmann::json& object_;
  std::string where_;
  Complaint complaint_;
};

}  // namespace nadir
