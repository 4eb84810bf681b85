// Place retrieval with a descriptor that can be exchanged: which of many patches of ground does a picture show? So that
// descriptors are compared on the same pictures (`nadir evaluate`, `./run bench retrieval`).
//
// A picture is described at nine small shifts for every heading that is possible, as the place index does
// (vision/place_index.hpp); a patch's score is the largest inner product. Equal scores go by number.
#pragma once

#include <cstddef>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "vision/place_descriptor.hpp"

namespace nadir {

class PlaceDescriber {
 public:
  virtual ~PlaceDescriber() = default;
  virtual std::string_view name() const = 0;
  // Looks at the ground that will be searched, before anything is described.
  virtual void train(std::span<const PlacePatch> /*ground*/) {}
  // Of length 1; nothing where the patch shows too little. The same number of components each time.
  virtual std::optional<std::vector<float>> describe(const PlacePatch& patch) const = 0;
};

// The 384 numbers of describe_place(); and the 128 of their projection, trained on the patches that are searched.
std::unique_ptr<PlaceDescriber> make_gradient_describer();
std::unique_ptr<PlaceDescriber> make_projected_gradient_describer();

// A picture, north up under an assumed heading, and the headings that are possible.
struct PlaceView {
  cv::Mat grey;                   // CV_8UC1
  cv::Mat mask;                   // CV_8UC1, 255 where it shows ground
  double pixels_per_px = 1;       // pixels of the picture for one of a patch
  std::vector<double> turns_rad;  // to be added to the assumed heading
};

// All around, as the place index tries them: 24.
std::vector<double> all_turns();

class PlaceGallery {
 public:
  // describer: must outlive the gallery. patches: all of one size; one that cannot be described is never found.
  PlaceGallery(const PlaceDescriber& describer, std::span<const PlacePatch> patches);

  std::size_t size() const { return described_.size(); }
  // The `count` best patches by their numbers, the best first; fewer where the picture cannot be described.
  std::vector<std::size_t> rank(const PlaceView& view, std::size_t count) const;

 private:
  const PlaceDescriber& describer_;
  int side_px_ = 0;
  std::size_t components_ = 0;
  std::vector<float> vectors_;   // rows
  std::vector<bool> described_;  // a row of zeros otherwise
};

}  // namespace nadir
