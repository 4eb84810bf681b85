// Why a file is of no use as a tile set. code is that of the finding that it becomes: "tiff.corrupt" (damaged, or its
// medium is), "tiff.grid" (not on the Web Mercator grid), "tiff.layout" (a form of TIFF that is not read here).
#pragma once

#include "base/error.hpp"

namespace nadir {

class CogError : public Error {
 public:
  CogError(const char* code, ErrorText text) : Error(std::move(text)), code_(code) {}
  const char* code() const { return code_; }

 private:
  const char* code_;
};

}  // namespace nadir
