#include "bench/xfeat_keypoints.hpp"

#include <dlfcn.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "base/error.hpp"
#include "base/files.hpp"
#include "vision/network_plugin_abi.h"

namespace nadir {
namespace {

// As the authors' program has them.
constexpr float kLeastScore = 0.05F;
constexpr int kSuppressed_px = 5;  // side of the square in which a keypoint is the best
constexpr int kCell_px = 8, kSide_px = 32;
constexpr double kFrame_px = 256;               // as the dense channels: localizer_parameters.hpp
constexpr int kPart_px = 768, kMargin_px = 64;  // likewise
constexpr std::array kOutputs = {"descriptors", "keypoint_logits", "reliability"};

using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using MapOfRows = Eigen::Map<const Rows>;

class XfeatKeypoints final : public KeypointBackend {
 public:
  XfeatKeypoints(const std::filesystem::path& model, const std::filesystem::path& plugin)
      : handle_(::dlopen(plugin.c_str(), RTLD_NOW | RTLD_LOCAL)) {
    using Entry = const NadirNetworkPlugin* (*)();
    const auto entry = handle_ == nullptr ? nullptr : reinterpret_cast<Entry>(::dlsym(handle_, "nadir_network_plugin"));
    if (entry == nullptr) throw Error({.what = "cannot load the network plug-in", .where = plugin});
    plugin_ = entry();
    const Bytes bytes = read_file(model, std::int64_t{64} << 20);
    std::array<char, 512> why{};
    if (plugin_->runtime(why.data(), why.size()) != nullptr) {
      network_ =
          plugin_->open(bytes.data(), bytes.size(), "input", kOutputs.data(), kOutputs.size(), why.data(), why.size());
    }
    if (network_ == nullptr) throw Error({.what = "the network cannot be loaded", .found = why.data()});
  }
  ~XfeatKeypoints() override {
    if (network_ != nullptr) plugin_->close(network_);
  }
  XfeatKeypoints(const XfeatKeypoints&) = delete;
  XfeatKeypoints& operator=(const XfeatKeypoints&) = delete;

  KeypointSet find(const cv::Mat& grey, const cv::Mat& mask, int most) override {
    cv::Mat filled(grey.size(), CV_8UC1, cv::mean(grey, mask)), inner;
    grey.copyTo(filled, mask);
    cv::erode(mask, inner, cv::getStructuringElement(cv::MORPH_RECT, {9, 9}), {-1, -1}, 1, cv::BORDER_CONSTANT,
              cv::Scalar(255));
    found_.clear();
    for (int top = 0; top < grey.rows; top += kPart_px) {
      for (int left = 0; left < grey.cols; left += kPart_px) {
        const cv::Rect whole(0, 0, grey.cols, grey.rows), taken = cv::Rect(left, top, kPart_px, kPart_px) & whole;
        const cv::Rect shown =
            cv::Rect(left - kMargin_px, top - kMargin_px, kPart_px + 2 * kMargin_px, kPart_px + 2 * kMargin_px) & whole;
        if (cv::countNonZero(inner(taken)) > 0) find_in(filled(shown), inner, shown.tl(), taken);
      }
    }
    std::stable_sort(found_.begin(), found_.end(), [](const Found& a, const Found& b) { return a.score > b.score; });
    found_.resize(std::min(found_.size(), static_cast<std::size_t>(most)));
    KeypointSet set;
    set.descriptors.create(static_cast<int>(found_.size()), 64, CV_32FC1);
    for (std::size_t i = 0; i < found_.size(); ++i) {
      set.points.push_back(found_[i].at);
      std::copy(found_[i].descriptor.begin(), found_[i].descriptor.end(),
                set.descriptors.ptr<float>(static_cast<int>(i)));
    }
    return set;
  }

  // Where each is the other's nearest.
  std::vector<FeatureMatch> pairs(const KeypointSet& frame, const KeypointSet& map) override {
    if (frame.points.empty() || map.points.empty()) return {};
    const MapOfRows a(frame.descriptors.ptr<float>(), frame.descriptors.rows, 64),
        b(map.descriptors.ptr<float>(), map.descriptors.rows, 64);
    const Rows likeness = a * b.transpose();
    std::vector<Eigen::Index> of_map(map.points.size());
    for (Eigen::Index i = 0; i < likeness.cols(); ++i) likeness.col(i).maxCoeff(&of_map[static_cast<std::size_t>(i)]);
    std::vector<FeatureMatch> pairs;
    for (Eigen::Index i = 0; i < likeness.rows(); ++i) {
      Eigen::Index nearest = 0;
      likeness.row(i).maxCoeff(&nearest);
      if (of_map[static_cast<std::size_t>(nearest)] == i) {
        pairs.push_back({static_cast<std::size_t>(i), static_cast<std::size_t>(nearest)});
      }
    }
    return pairs;
  }

  double most_frame_px() const override { return kFrame_px; }

 private:
  struct Found {
    cv::Point2f at;
    float score = 0;
    std::array<float, 64> descriptor{};
  };

  void find_in(const cv::Mat& picture, const cv::Mat& mask, cv::Point corner, const cv::Rect& taken) {
    cv::Mat shown, plane;
    cv::copyMakeBorder(picture, shown, 0, (kSide_px - picture.rows % kSide_px) % kSide_px, 0,
                       (kSide_px - picture.cols % kSide_px) % kSide_px, cv::BORDER_REPLICATE);
    shown.convertTo(plane, CV_32FC1, 1 / 255.0);
    cv::Mat input(3 * shown.rows, shown.cols, CV_32FC1);
    for (int i = 0; i < 3; ++i) plane.copyTo(input.rowRange(i * shown.rows, (i + 1) * shown.rows));
    const NadirNetworkTensor image{input.ptr<float>(), {1, 3, shown.rows, shown.cols}};
    std::array<NadirNetworkTensor, kOutputs.size()> results{};
    std::array<char, 512> why{};
    if (plugin_->run(network_, &image, results.data(), why.data(), why.size()) != 0) {
      throw Error({.what = "the network cannot be run", .found = why.data()});
    }
    const int rows = shown.rows / kCell_px, columns = shown.cols / kCell_px;
    const auto cells = static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns);
    const auto at = [&](const NadirNetworkTensor& tensor, int channel, int row, int column) {
      return tensor.data[static_cast<std::size_t>(channel) * cells + static_cast<std::size_t>(row * columns + column)];
    };
    const auto& [descriptors, logits, reliability] = results;
    cv::Mat heat(shown.size(), CV_32FC1);
    for (int r = 0; r < rows; ++r) {
      for (int c = 0; c < columns; ++c) {
        float sum = 0;
        for (int k = 0; k < 65; ++k) sum += std::exp(at(logits, k, r, c));
        for (int k = 0; k < 64; ++k) {
          heat.at<float>(r * kCell_px + k / kCell_px, c * kCell_px + k % kCell_px) =
              std::exp(at(logits, k, r, c)) / sum;
        }
      }
    }
    cv::Mat best;
    cv::dilate(heat, best, cv::getStructuringElement(cv::MORPH_RECT, {kSuppressed_px, kSuppressed_px}));
    for (int y = 0; y < picture.rows; ++y) {
      for (int x = 0; x < picture.cols; ++x) {
        const float score = heat.at<float>(y, x);
        const cv::Point place = corner + cv::Point(x, y);
        if (score <= kLeastScore || score < best.at<float>(y, x) || !taken.contains(place)) continue;
        if (mask.at<std::uint8_t>(place) == 0) continue;
        // Between the four cells around it.
        const double column = std::clamp((x + 0.5) / kCell_px - 0.5, 0.0, columns - 1.001),
                     row = std::clamp((y + 0.5) / kCell_px - 0.5, 0.0, rows - 1.001);
        const int c = static_cast<int>(column), r = static_cast<int>(row);
        const auto right = static_cast<float>(column - c), down = static_cast<float>(row - r);
        const auto between = [&](const NadirNetworkTensor& tensor, int channel) {
          const float above = at(tensor, channel, r, c) * (1 - right) + at(tensor, channel, r, c + 1) * right,
                      below = at(tensor, channel, r + 1, c) * (1 - right) + at(tensor, channel, r + 1, c + 1) * right;
          return above * (1 - down) + below * down;
        };
        Found& found = found_.emplace_back();
        found.at = cv::Point2f(place);
        found.score = score * between(reliability, 0);
        float squares = 0;
        for (int k = 0; k < 64; ++k) {
          const float value = between(descriptors, k);
          found.descriptor[static_cast<std::size_t>(k)] = value;
          squares += value * value;
        }
        for (float& value : found.descriptor) value /= std::sqrt(std::max(squares, 1e-12F));
      }
    }
  }

  void* handle_;  // stays loaded
  const NadirNetworkPlugin* plugin_ = nullptr;
  void* network_ = nullptr;
  std::vector<Found> found_;
};

}  // namespace

std::shared_ptr<KeypointBackend> make_xfeat_keypoints(const std::filesystem::path& model,
                                                      const std::vector<std::filesystem::path>& plugins) {
  for (const std::filesystem::path& folder : plugins) {
    const auto plugin = folder / "nadir_network_onnxruntime.so";
    if (std::filesystem::exists(plugin)) return std::make_shared<XfeatKeypoints>(model, plugin);
  }
  throw Error({.what = "network plug-in not installed", .where = "nadir_network_onnxruntime.so"});
}

}  // namespace nadir
