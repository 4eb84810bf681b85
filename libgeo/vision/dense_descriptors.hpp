// Dense descriptors: a small vector for every cell of an image that says what is there, learned so that it stays alike
// when season, light and sensor change. A descriptor network turns H x W pixels into H/8 x W/8 cells of C channels.
//
//   grey image, 8 px: ┌──┬──┬──┐      ┌─┬─┬─┐
//                     ├──┼──┼──┤  →   ├─┼─┼─┤  of unit vectors
//                     └──┴──┴──┘      └─┴─┴─┘
//
// Where the networks come from is not known here: an ONNX file behind a plug-in (network_plugin.hpp), or a forward pass
// of our own. Two pictures are compared by correlating their cells as channels (descriptor_matcher.hpp). For that a few
// principal channels suffice: of C channels those K directions in which the cells of one picture differ most,
//   y = Vᵀ x,   V = the K first eigenvectors of the cells' covariance,
// keep most of what tells places apart, at a fraction of the transforms.
//
// Results of a network may differ in their last bits between processors and versions of a library; what uses one says
// so. None is needed by anything.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <string>

#include "base/progress.hpp"
#include "vision/oriented_channels.hpp"

namespace nadir {

inline constexpr int kDescriptorCell_px = 8;
inline constexpr int kDescriptorSide_px = 32;  // sides of what a network is given are multiples of it

class DenseDescriptorNetwork {
 public:
  virtual ~DenseDescriptorNetwork() = default;
  virtual int channels() const = 0;
  // What it is, for reports: a model's file and digest, what runs it.
  virtual std::string name() const = 0;
  // grey: CV_8UC1, its sides multiples of kDescriptorSide_px. Result: a cell for 8 x 8 pixels, CV_32FC(channels()), of
  // any length but 0. One call at a time; not always from the same thread. Throws Error when it fails.
  virtual cv::Mat describe(const cv::Mat& grey) = 0;
};

// The cells of a picture, as unit vectors.
struct DescribedPicture {
  cv::Mat cells;  // CV_32FC(channels); 0 where the mask is
  cv::Mat mask;   // CV_8UC1: 255 where a cell is on the picture, and so are those beside it
};

// grey: CV_8UC1 of any size; pixels beyond the last whole cell are left out. mask: CV_8UC1, or empty (everything
// valid); what it excludes is shown to the network as the mean grey level. A large picture is described in overlapping
// parts, so that memory stays bounded. Throws Error when the network gives something else than it promises (another
// size, or values that are not finite).
DescribedPicture described(DenseDescriptorNetwork& network, const cv::Mat& grey, const cv::Mat& mask,
                           const Cancel& cancel = {});

// K principal channels of one picture's cells, applied to those of any.
class PrincipalChannels {
 public:
  // All channels, as many as there are, when count is that many or more, or where the picture has no valid cell.
  PrincipalChannels(const DescribedPicture& of, int count);

  DescribedPicture project(const DescribedPicture& picture) const;

 private:
  Eigen::MatrixXf directions_;  // a column for each; empty: the channels as they are
};

// As the channels that are correlated: a pixel for each cell.
Channels channels_of(const DescribedPicture& picture);

}  // namespace nadir
