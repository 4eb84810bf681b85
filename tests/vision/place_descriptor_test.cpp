#include "vision/place_descriptor.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <opencv2/imgproc.hpp>

#include "base/random.hpp"
#include "geodesy/angles.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

const test::Landscape& descriptor_landscape() {
  static const test::Landscape world(11, 200);
  return world;
}

PlacePatch patch_at(cv::Point2d centre, double turn_rad = 0, bool reversed = false) {
  const MapWindow map = descriptor_landscape().map(1.0, reversed);
  return PatchCutter(map.image, map.mask, 1.2)
      .cut({.centre = centre, .turn_rad = turn_rad, .pixels_per_px = 1.2, .shift_px = {}, .side_px = 96});
}

double cosine(const RawPlaceDescriptor& a, const RawPlaceDescriptor& b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

TEST(PlaceDescriptor, HasUnitLengthAndIsDeterministic) {
  const auto first = describe_place(patch_at({200, 200}));
  const auto again = describe_place(patch_at({200, 200}));
  ASSERT_TRUE(first && again);
  EXPECT_NEAR(cosine(*first, *first), 1, 1e-5);
  EXPECT_EQ(*first, *again);
}

TEST(PlaceDescriptor, IsInvariantToLightAndContrastReversal) {
  const PlacePatch patch = patch_at({200, 200});
  PlacePatch negative = patch, dim = patch;
  negative.grey = 255 - patch.grey;
  dim.grey = patch.grey * 0.5 + 40;
  const auto a = describe_place(patch), b = describe_place(negative), c = describe_place(dim);
  ASSERT_TRUE(a && b && c);
  EXPECT_GT(cosine(*a, *b), 0.9999);
  EXPECT_GT(cosine(*a, *c), 0.95);
}

TEST(PlaceDescriptor, DistinguishesPlacesButToleratesASmallShift) {
  const auto here = describe_place(patch_at({150, 150}));
  const auto shifted = describe_place(patch_at({154, 147}, 0, true));
  const auto elsewhere = describe_place(patch_at({260, 240}, 0, true));
  ASSERT_TRUE(here && shifted && elsewhere);
  EXPECT_GT(cosine(*here, *shifted), 0.5);
  EXPECT_LT(cosine(*here, *elsewhere), 0.35);
}

TEST(PlaceDescriptor, EachChannelHasZeroMeanOverTheCellsWithGround) {
  PlacePatch patch = patch_at({200, 200});
  cv::rectangle(patch.mask, cv::Rect(0, 0, 40, 96), cv::Scalar(0), cv::FILLED);
  const auto descriptor = describe_place(patch);
  ASSERT_TRUE(descriptor);
  int zeros = 0;
  for (std::size_t k = 0; k < kRawPlaceSize; ++k) {
    if (k % kPlaceCells == 0) {
      EXPECT_EQ((*descriptor)[k], 0) << k;
    }
    zeros += (*descriptor)[k] == 0;
  }
  EXPECT_GE(zeros, 3 * kPlaceCells * kPlaceOrientations) << "three columns of cells are hidden";
  // Undo the root: the values' sum is nothing.
  for (int channel = 0; channel < kPlaceOrientations; ++channel) {
    double sum = 0, most = 0;
    for (int k = 0; k < kPlaceCells * kPlaceCells; ++k) {
      const auto v = static_cast<double>((*descriptor)[static_cast<std::size_t>(channel * 64 + k)]);
      sum += v * std::abs(v);
      most = std::max(most, v * v);
    }
    EXPECT_NEAR(sum, 0, 1e-3 * most) << channel;
  }
}

TEST(PlaceDescriptor, IgnoresMaskedPixels) {
  PlacePatch patch = patch_at({200, 200});
  cv::rectangle(patch.mask, cv::Rect(60, 0, 36, 96), cv::Scalar(0), cv::FILLED);
  PlacePatch other = patch;
  other.grey = patch.grey.clone();
  cv::Mat hidden = other.grey(cv::Rect(64, 0, 32, 96));
  Random random(3);
  for (int row = 0; row < hidden.rows; ++row) {
    for (int column = 0; column < hidden.cols; ++column) {
      hidden.at<std::uint8_t>(row, column) = static_cast<std::uint8_t>(random.integer(0, 255));
    }
  }
  const auto a = describe_place(patch), b = describe_place(other);
  ASSERT_TRUE(a && b);
  EXPECT_GT(cosine(*a, *b), 0.99);
}

TEST(PlaceDescriptor, NoDescriptorWithoutStructure) {
  const cv::Mat grey(96, 96, CV_8UC1, cv::Scalar(90)), all(96, 96, CV_8UC1, cv::Scalar(255));
  EXPECT_FALSE(describe_place({grey, all}));
  EXPECT_EQ(texture_of({grey, all}), 0);
  PlacePatch hidden = patch_at({200, 200});
  hidden.mask.setTo(0);
  EXPECT_FALSE(describe_place(hidden));
  EXPECT_EQ(texture_of(hidden), 0);
  EXPECT_GT(texture_of(patch_at({200, 200})), kMinPlaceTexture);
}

TEST(PatchCutter, TurnsClockwiseAndShiftsAlongThePatch) {
  cv::Mat grey(200, 200, CV_8UC1, cv::Scalar(0)), mask(200, 200, CV_8UC1, cv::Scalar(255));
  cv::circle(grey, {100, 60}, 4, cv::Scalar(255), cv::FILLED);  // north of the middle
  const PatchCutter cutter(grey, mask, 1);
  PatchPlacement placement{
      .centre = {100.5, 100.5}, .turn_rad = radians(-90), .pixels_per_px = 1, .shift_px = {}, .side_px = 101};
  // The patch's rows run anticlockwise of the image's: its east is the image's north.
  EXPECT_EQ(cutter.cut(placement).grey.at<std::uint8_t>(50, 90), 255);
  placement.shift_px = {40, 0};
  EXPECT_EQ(cutter.cut(placement).grey.at<std::uint8_t>(50, 50), 255);
  placement.centre = {10, 10};
  EXPECT_EQ(cutter.cut(placement).mask.at<std::uint8_t>(50, 100), 0) << "beyond the picture";
}

TEST(PlaceProjection, IsAnOrthonormalBasisWithFixedSigns) {
  Random random(5);
  std::vector<RawPlaceDescriptor> samples(600);
  for (auto& sample : samples) {
    for (std::size_t k = 0; k < kRawPlaceSize; ++k) {
      sample[k] = static_cast<float>(random.normal() / (1.0 + 0.1 * static_cast<double>(k)) / 4);
    }
  }
  const PlaceProjection projection = train_projection(samples);
  EXPECT_GT(projection.kept, 0.9);
  EXPECT_LE(projection.kept, 1);
  const auto row = [&](std::size_t r) { return std::span(projection.basis).subspan(r * kRawPlaceSize, kRawPlaceSize); };
  for (std::size_t a = 0; a < kPlaceSize; a += 7) {
    for (std::size_t b = a; b < kPlaceSize; b += 11) {
      const double product = std::inner_product(row(a).begin(), row(a).end(), row(b).begin(), 0.0);
      EXPECT_NEAR(product, a == b ? 1 : 0, 1e-4) << a << ' ' << b;
    }
    const auto largest =
        std::max_element(row(a).begin(), row(a).end(), [](float x, float y) { return std::abs(x) < std::abs(y); });
    EXPECT_GT(*largest, 0) << a;
  }
  EXPECT_EQ(train_projection(samples).basis, projection.basis);
  const PlaceVector vector = projection.project(samples[7]);
  EXPECT_NEAR(std::inner_product(vector.begin(), vector.end(), vector.begin(), 0.0), 1, 1e-5);
  // Few samples, or none that differ: components, if meaningless ones.
  EXPECT_EQ(train_projection(std::span(samples).first(2)).basis.size(), kPlaceSize * kRawPlaceSize);
}

}  // namespace
}  // namespace nadir
