#include "datasets/place_gallery.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <numbers>

#include "base/error.hpp"

namespace nadir {
namespace {

std::vector<float> as_vector(std::span<const float> numbers) { return {numbers.begin(), numbers.end()}; }

class GradientDescriber final : public PlaceDescriber {
 public:
  std::string_view name() const override { return "oriented gradients, 384"; }
  std::optional<std::vector<float>> describe(const PlacePatch& patch) const override {
    const auto raw = describe_place(patch);
    return raw ? std::optional(as_vector(*raw)) : std::nullopt;
  }
};

class ProjectedGradientDescriber final : public PlaceDescriber {
 public:
  std::string_view name() const override { return "oriented gradients, 128"; }
  void train(std::span<const PlacePatch> ground) override {
    std::vector<RawPlaceDescriptor> samples;
    for (const PlacePatch& patch : ground) {
      if (const auto raw = describe_place(patch)) samples.push_back(*raw);
    }
    projection_ = train_projection(samples);
  }
  std::optional<std::vector<float>> describe(const PlacePatch& patch) const override {
    const auto raw = describe_place(patch);
    return raw ? std::optional(as_vector(projection_.project(*raw))) : std::nullopt;
  }

 private:
  PlaceProjection projection_;
};

}  // namespace

std::unique_ptr<PlaceDescriber> make_gradient_describer() { return std::make_unique<GradientDescriber>(); }
std::unique_ptr<PlaceDescriber> make_projected_gradient_describer() {
  return std::make_unique<ProjectedGradientDescriber>();
}

std::vector<double> all_turns() {
  std::vector<double> turns;
  for (int i = 0; i < kQueryTurns; ++i) turns.push_back(2 * std::numbers::pi * i / kQueryTurns);
  return turns;
}

PlaceGallery::PlaceGallery(const PlaceDescriber& describer, std::span<const PlacePatch> patches)
    : describer_(describer) {
  for (const PlacePatch& patch : patches) {
    if (side_px_ == 0) side_px_ = patch.grey.cols;
    if (patch.grey.cols != side_px_ || patch.grey.rows != side_px_) {
      throw Error({.what = "the patches of a gallery are not all of one size"});
    }
    const auto vector = describer.describe(patch);
    described_.push_back(vector.has_value());
    if (!vector) continue;
    if (components_ == 0) components_ = vector->size();
    vectors_.resize((described_.size() - 1) * components_);
    vectors_.insert(vectors_.end(), vector->begin(), vector->end());
  }
  vectors_.resize(described_.size() * components_);
}

std::vector<std::size_t> PlaceGallery::rank(const PlaceView& view, std::size_t count) const {
  using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const PatchCutter cutter(view.grey, view.mask, view.pixels_per_px);
  const Eigen::Map<const Rows> rows(vectors_.data(), static_cast<Eigen::Index>(described_.size()),
                                    static_cast<Eigen::Index>(components_));
  Eigen::VectorXf best = Eigen::VectorXf::Constant(rows.rows(), -1);
  bool any = false;
  for (const double turn : view.turns_rad) {
    for (int i = -1; i <= 1; ++i) {
      for (int j = -1; j <= 1; ++j) {
        const auto vector = describer_.describe(cutter.cut({.centre = {view.grey.cols / 2.0, view.grey.rows / 2.0},
                                                            .turn_rad = -turn,
                                                            .pixels_per_px = view.pixels_per_px,
                                                            .shift_px = cv::Point2d(i, j) * (kQueryShift * side_px_),
                                                            .side_px = side_px_}));
        if (!vector || vector->size() != components_) continue;
        any = true;
        best = best.cwiseMax(rows * Eigen::Map<const Eigen::VectorXf>(vector->data(), rows.cols()));
      }
    }
  }
  if (!any) return {};
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < described_.size(); ++i) {
    if (described_[i]) order.push_back(i);
  }
  const std::size_t kept = std::min(count, order.size());
  std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(kept), order.end(),
                    [&](std::size_t a, std::size_t b) {
                      const float of_a = best[static_cast<Eigen::Index>(a)], of_b = best[static_cast<Eigen::Index>(b)];
                      return of_a != of_b ? of_a > of_b : a < b;
                    });
  order.resize(kept);
  return order;
}

}  // namespace nadir
