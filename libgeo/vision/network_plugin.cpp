#include "vision/network_plugin.hpp"

#include <dlfcn.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/printable.hpp"
#include "vision/localizer_parameters.hpp"
#include "vision/network_plugin_abi.h"
#include "vision/onnx_model.hpp"

namespace nadir {

using namespace parameters::learned_matching;
namespace fs = std::filesystem;

namespace {

constexpr const char* kPluginFile = "nadir_network_onnxruntime.so";
constexpr const char* kWithout = "or leave the model out: Nadir flies without it";

using NetworkErrorText = std::array<char, 512>;

std::string text_of(NetworkErrorText& error) {
  error.back() = '\0';
  return error.front() == '\0' ? "no reason given" : printable(error.data());
}

// The loaded library. Stays loaded as long as a network of it.
class NetworkPlugin {
 public:
  explicit NetworkPlugin(const fs::path& library) : handle_(::dlopen(library.c_str(), RTLD_NOW | RTLD_LOCAL)) {
    if (handle_ == nullptr) {
      const char* why = ::dlerror();  // NOLINT(concurrency-mt-unsafe): glibc keeps one text per thread
      throw Error({.what = "cannot load the network plug-in",
                   .where = library,
                   .found = why == nullptr ? "no reason given" : why,
                   .fix = fmt::format("install the plug-in again, {}", kWithout)});
    }
    using Entry = const NadirNetworkPlugin* (*)();
    const auto entry = reinterpret_cast<Entry>(::dlsym(handle_, "nadir_network_plugin"));
    table_ = entry == nullptr ? nullptr : entry();
    if (table_ == nullptr || table_->version != NADIR_NETWORK_PLUGIN_VERSION) {
      const std::string found = table_ == nullptr ? "none" : fmt::format("version {}", table_->version);
      ::dlclose(handle_);
      throw Error({.what = "not a network plug-in for this program",
                   .where = library,
                   .expected = fmt::format("nadir_network_plugin of version {}", NADIR_NETWORK_PLUGIN_VERSION),
                   .found = found,
                   .fix = "install the plug-in of the same version as the program"});
    }
  }
  ~NetworkPlugin() { ::dlclose(handle_); }
  NetworkPlugin(const NetworkPlugin&) = delete;
  NetworkPlugin& operator=(const NetworkPlugin&) = delete;

  const NadirNetworkPlugin* operator->() const { return table_; }

 private:
  void* handle_;
  const NadirNetworkPlugin* table_ = nullptr;
};

class PluginNetwork final : public DenseDescriptorNetwork {
 public:
  PluginNetwork(std::shared_ptr<NetworkPlugin> plugin, DescriptorModel model, ByteView bytes, std::string name)
      : plugin_(std::move(plugin)), model_(std::move(model)), name_(std::move(name)) {
    NetworkErrorText error{};
    const char* output = model_.descriptors.c_str();
    network_ =
        (*plugin_)->open(bytes.data(), bytes.size(), model_.input.c_str(), &output, 1, error.data(), error.size());
    if (network_ == nullptr) fail("the network cannot be loaded", text_of(error));
  }
  ~PluginNetwork() override { (*plugin_)->close(network_); }
  PluginNetwork(const PluginNetwork&) = delete;
  PluginNetwork& operator=(const PluginNetwork&) = delete;

  int channels() const override { return model_.channels; }
  std::string name() const override { return name_; }

  cv::Mat describe(const cv::Mat& grey) override {
    cv::Mat plane, input(model_.input_channels * grey.rows, grey.cols, CV_32FC1);
    grey.convertTo(plane, CV_32FC1, 1 / 255.0);
    for (int i = 0; i < model_.input_channels; ++i) plane.copyTo(input.rowRange(i * grey.rows, (i + 1) * grey.rows));
    const NadirNetworkTensor image{input.ptr<float>(), {1, model_.input_channels, grey.rows, grey.cols}};
    NadirNetworkTensor result{};
    NetworkErrorText error{};
    if ((*plugin_)->run(network_, &image, &result, error.data(), error.size()) != 0) {
      fail("the network cannot be run", text_of(error));
    }
    const std::array<std::int64_t, 4> expected = {1, model_.channels, grey.rows / kDescriptorCell_px,
                                                  grey.cols / kDescriptorCell_px};
    if (result.data == nullptr || !std::equal(expected.begin(), expected.end(), std::begin(result.shape))) {
      throw Error({.what = "the descriptor network gives what it should not",
                   .where = name_,
                   .expected = fmt::format("{}", fmt::join(expected, " x ")),
                   .found = fmt::format("{}", fmt::join(result.shape, " x ")),
                   .fix = "use a network with a descriptor for 8 x 8 pixels (docs/second-matcher.md)"});
    }
    // From planes to cells.
    const auto rows = static_cast<int>(expected[2]), columns = static_cast<int>(expected[3]);
    cv::Mat cells(rows, columns, CV_32FC(model_.channels));
    const std::size_t plane_size = static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns);
    for (int k = 0; k < model_.channels; ++k) {
      const float* from = result.data + static_cast<std::size_t>(k) * plane_size;
      auto* to = cells.ptr<float>() + k;
      for (std::size_t i = 0; i < plane_size; ++i) to[i * static_cast<std::size_t>(model_.channels)] = from[i];
    }
    return cells;
  }

 private:
  [[noreturn]] void fail(const char* what, const std::string& found) const {
    throw Error({.what = what,
                 .where = name_,
                 .found = found,
                 .fix = fmt::format("use another model or version of the library, {}", kWithout)});
  }

  std::shared_ptr<NetworkPlugin> plugin_;
  DescriptorModel model_;
  std::string name_;
  void* network_ = nullptr;
};

fs::path find_network_plugin(const std::vector<fs::path>& folders) {
  std::vector<std::string> searched;
  for (const fs::path& folder : folders) {
    if (fs::exists(folder / kPluginFile)) return folder / kPluginFile;
    searched.push_back(folder.string());
  }
  throw Error({.what = "network plug-in not installed",
               .where = kPluginFile,
               .expected = fmt::format("in one of: {}", fmt::join(searched, ", ")),
               .fix = fmt::format("build it where ONNX Runtime's header is found (docs/building.md), {}", kWithout)});
}

// A picture of a few lines and areas, so that an untried network shows what it gives.
cv::Mat trial_picture(int side) {
  cv::Mat picture(side, side, CV_8UC1);
  for (int r = 0; r < side; ++r) {
    for (int c = 0; c < side; ++c) {
      picture.at<std::uint8_t>(r, c) = static_cast<std::uint8_t>((r * r / 7 + c * 13 + (r * c) / 11) & 255);
    }
  }
  return picture;
}

}  // namespace

OpenedNetwork open_network(const NetworkFile& file, const std::vector<fs::path>& plugins) {
  const Bytes bytes = read_file(file.model, kMaxModelBytes);
  OpenedNetwork opened;
  opened.digest = sha256(bytes);
  if (file.digest && *file.digest != opened.digest) {
    throw Error({.what = "the matcher's model is not the one that was chosen",
                 .where = file.model,
                 .expected = fmt::format("SHA-256 {}", file.digest->hex()),
                 .found = opened.digest.hex(),
                 .fix = "copy the model again, or state its digest where it is named"});
  }
  const DescriptorModel model = descriptor_model(read_onnx_model(bytes, file.model.string()), file.model.string());
  const auto plugin = std::make_shared<NetworkPlugin>(find_network_plugin(plugins));
  NetworkErrorText error{};
  const char* runtime = (*plugin)->runtime(error.data(), error.size());
  if (runtime == nullptr) {
    throw Error({.what = "the library that runs networks cannot be used",
                 .where = "libonnxruntime.so.1",
                 .found = text_of(error),
                 .fix = fmt::format("install ONNX Runtime beside the plug-in (docs/second-matcher.md), {}", kWithout)});
  }
  opened.runtime = printable(runtime);
  opened.network = std::make_shared<PluginNetwork>(
      plugin, model, bytes, fmt::format("{} ({})", file.model.filename().string(), opened.digest.hex().substr(0, 12)));
  described(*opened.network, trial_picture(2 * kDescriptorSide_px), {});
  return opened;
}

double network_cost_ms(DenseDescriptorNetwork& network, const std::function<double()>& processor_s) {
  const int side = static_cast<int>(kDescribedFrame_px) / kDescriptorSide_px * kDescriptorSide_px;
  const cv::Mat picture = trial_picture(side);
  double least_s = std::numeric_limits<double>::infinity();
  for (int i = 0; i <= kNetworkTrials; ++i) {
    const double begin_s = processor_s();
    described(network, picture, {});
    if (i > 0) least_s = std::min(least_s, processor_s() - begin_s);
  }
  return least_s * 1e3;
}

}  // namespace nadir
