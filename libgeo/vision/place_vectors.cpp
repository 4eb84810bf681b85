#include "vision/place_vectors.hpp"

#include <faiss/IndexFlat.h>
#include <faiss/impl/FaissException.h>
#include <faiss/impl/IDSelector.h>
#include <faiss/impl/io.h>
#include <faiss/index_io.h>
#include <fmt/format.h>

#include <algorithm>
#include <cstring>

#include "base/error.hpp"

namespace nadir {
namespace {

// What FAISS 1.7 writes for a flat index: "IxFI", dimension, number of vectors, two unused numbers, whether it is
// trained, metric; then the number of floats, and the floats.
constexpr std::size_t kHeader = 4 + 4 + 8 + 8 + 8 + 1 + 4;
constexpr std::size_t kPrefix = kHeader + 8;

// FAISS hands 20 queries or more to BLAS, whose sums depend on whose BLAS it is; fewer it works through one by one.
constexpr std::size_t kBatch = 16;

template <typename T>
T number_at(ByteView bytes, std::size_t at) {
  T value{};
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

void check_form(ByteView file, std::size_t count, std::string_view name) {
  const auto refuse = [&](std::string expected, std::string found) {
    throw Error({.what = "this is no place index",
                 .where = std::string(name),
                 .expected = std::move(expected),
                 .found = std::move(found),
                 .fix = "make it again with `nadir cache index`"});
  };
  const std::size_t size = kPrefix + count * kPlaceSize * sizeof(float);
  if (file.size() != size) refuse(fmt::format("{} bytes", size), fmt::format("{} bytes", file.size()));
  if (as_text(file.first(4)) != "IxFI") refuse("a flat index of inner products (IxFI)", "another kind of index");
  const auto dimension = number_at<std::int32_t>(file, 4);
  if (dimension != static_cast<std::int32_t>(kPlaceSize)) {
    refuse(fmt::format("vectors of {} numbers", kPlaceSize), std::to_string(dimension));
  }
  const auto vectors = number_at<std::int64_t>(file, 8);
  const auto floats = number_at<std::uint64_t>(file, kHeader);
  if (vectors != static_cast<std::int64_t>(count) || floats != count * kPlaceSize) {
    refuse(fmt::format("{} vectors", count), fmt::format("{} vectors, {} numbers", vectors, floats));
  }
  if (number_at<std::uint8_t>(file, 32) != 1 || number_at<std::int32_t>(file, 33) != faiss::METRIC_INNER_PRODUCT) {
    refuse("a trained index of inner products", "another one");
  }
}

}  // namespace

struct PlaceVectors::Impl {
  faiss::IndexFlatIP index{static_cast<faiss::Index::idx_t>(kPlaceSize)};
};

PlaceVectors::PlaceVectors(std::span<const PlaceVector> vectors) : impl_(std::make_unique<Impl>()) {
  impl_->index.add(static_cast<faiss::Index::idx_t>(vectors.size()), vectors.empty() ? nullptr : vectors[0].data());
}

PlaceVectors::PlaceVectors(ByteView file, std::size_t count, std::string_view name) : impl_(std::make_unique<Impl>()) {
  check_form(file, count, name);
  try {
    faiss::VectorIOReader reader;
    reader.data.assign(file.begin(), file.end());
    const std::unique_ptr<faiss::Index> read(faiss::read_index(&reader));
    auto* flat = dynamic_cast<faiss::IndexFlatIP*>(read.get());
    if (flat == nullptr) throw Error({.what = "this is no flat index", .where = std::string(name)});
    impl_->index = std::move(*flat);
  } catch (const faiss::FaissException& error) {
    throw Error({.what = "FAISS cannot read the place index", .where = std::string(name), .found = error.what()});
  }
  const std::span<const float> all(impl_->index.get_xb(), count * kPlaceSize);
  const bool sound = std::all_of(all.begin(), all.end(), [](float v) { return v >= -1.001F && v <= 1.001F; });
  if (!sound) {  // NaN is not sound either
    throw Error({.what = "the place index holds impossible numbers",
                 .where = std::string(name),
                 .expected = "vectors of length 1",
                 .found = "numbers beyond 1, or none at all"});
  }
}

PlaceVectors::~PlaceVectors() = default;
PlaceVectors::PlaceVectors(PlaceVectors&&) noexcept = default;
PlaceVectors& PlaceVectors::operator=(PlaceVectors&&) noexcept = default;

Bytes PlaceVectors::file() const {
  faiss::VectorIOWriter writer;
  faiss::write_index(&impl_->index, &writer);
  return writer.data;
}

std::size_t PlaceVectors::size() const { return static_cast<std::size_t>(impl_->index.ntotal); }

std::span<const float> PlaceVectors::vector(std::size_t index) const {
  return {impl_->index.get_xb() + index * kPlaceSize, kPlaceSize};
}

std::vector<std::vector<PlaceVectors::Hit>> PlaceVectors::search(std::span<const PlaceVector> queries,
                                                                 std::size_t first, std::size_t count, std::size_t best,
                                                                 const Cancel& cancel) const {
  best = std::min(best, count);
  std::vector<std::vector<Hit>> result(queries.size());
  if (best == 0) return result;
  using Id = faiss::Index::idx_t;
  faiss::IDSelectorRange range(static_cast<Id>(first), static_cast<Id>(first + count));
  faiss::SearchParameters parameters;
  parameters.sel = &range;
  const bool whole = count == size();
  std::vector<float> scores(kBatch * best);
  std::vector<Id> labels(kBatch * best);
  for (std::size_t begin = 0; begin < queries.size(); begin += kBatch) {
    cancel.check();
    const std::size_t n = std::min(kBatch, queries.size() - begin);
    impl_->index.search(static_cast<Id>(n), queries[begin].data(), static_cast<Id>(best), scores.data(), labels.data(),
                        whole ? nullptr : &parameters);
    for (std::size_t q = 0; q < n; ++q) {
      for (std::size_t k = 0; k < best; ++k) {
        const Id label = labels[q * best + k];
        if (label >= 0) result[begin + q].push_back({static_cast<std::size_t>(label), scores[q * best + k]});
      }
    }
  }
  return result;
}

}  // namespace nadir
