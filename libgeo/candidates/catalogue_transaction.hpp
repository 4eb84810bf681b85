// What the parts of the candidate service's catalogue share.
#pragma once

#include "candidates/catalogue_rows.hpp"
#include "catalogue/database.hpp"

namespace nadir {

// Without commit() everything is taken back.
class CatalogueTransaction {
 public:
  explicit CatalogueTransaction(CatalogueDatabase& database) : database_(database) { database_.begin(); }
  ~CatalogueTransaction() {
    if (!committed_) database_.roll_back();
  }
  CatalogueTransaction(const CatalogueTransaction&) = delete;
  CatalogueTransaction& operator=(const CatalogueTransaction&) = delete;

  void commit() {
    database_.commit();
    committed_ = true;
  }

 private:
  CatalogueDatabase& database_;
  bool committed_ = false;
};

CatalogueLayout candidate_catalogue_layout();

Sha256 digest_from(const CatalogueRow& row, const char* column);
BlobPlace blob_from(const CatalogueRow& row);  // of the columns pack, start, bytes

}  // namespace nadir
