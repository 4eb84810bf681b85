#include "raster/raster_source.hpp"

#include <fmt/format.h>
#include <gdal_alg.h>
#include <gdal_priv.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "geodesy/angles.hpp"
#include "imagery/node_grid.hpp"
#include "raster/gdal_dataset.hpp"

namespace nadir {
namespace {

constexpr int kBlock = 512;  // pixels warped at once: few enough to stay in the cache

// Raster coordinates of a block's pixels, at every kMapNodeStep_px pixels.
struct Nodes {
  int columns = 0;
  int rows = 0;
  std::vector<double> x, y;
  cv::Rect2d bounds;

  std::size_t index(int row, int column) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(column);
  }
  cv::Point2d at(int row, int column) const { return {x[index(row, column)], y[index(row, column)]}; }

  // Raster pixels per map pixel, the smaller of both directions.
  double shrink() const {
    const double across = cv::norm(at(0, 1) - at(0, 0)) / kMapNodeStep_px;
    const double down = cv::norm(at(1, 0) - at(0, 0)) / kMapNodeStep_px;
    return std::min(across, down);
  }
};

}  // namespace

struct RasterSource::Impl {
  Impl(const std::filesystem::path& path, std::optional<Stretch> stretch) : dataset(path, stretch) {
    const QuietGdal quiet;
    check_depth(stretch.has_value());
    check_georeference();
    OGRSpatialReference mercator;
    mercator.importFromEPSG(3857);
    char* wkt = nullptr;
    mercator.exportToWkt(&wkt);
    char** options = CSLSetNameValue(nullptr, "DST_SRS", wkt);
    transformer.reset(GDALCreateGenImgProjTransformer2(dataset.handle(), nullptr, options));
    CSLDestroy(options);
    CPLFree(wkt);
    if (!transformer) fail_transform();
    trace_outline();
  }

  void check_depth(bool stretched) const {
    if (dataset.layout().eight_bit || stretched) return;
    throw UsageError({.what = "the raster is not 8 bit",
                      .where = dataset.path().string(),
                      .expected = "8 bit, or a stretch",
                      .found = dataset.layout().type,
                      .fix = "state how its values become colours with --stretch"});
  }

  [[noreturn]] void fail_transform() const {
    throw UsageError({.what = "the raster's position on the map cannot be computed",
                      .where = dataset.path().string(),
                      .expected = "a coordinate reference system that PROJ can transform to Web Mercator",
                      .found = QuietGdal::last_error()});
  }

  void check_georeference() const {
    double transform[6];
    GDALDataset* handle = dataset.handle();
    const bool has_geotransform = handle->GetGeoTransform(transform) == CE_None || handle->GetGCPCount() > 0;
    const OGRSpatialReference* system = handle->GetSpatialRef();
    if (system == nullptr) system = handle->GetGCPSpatialRef();
    if (has_geotransform && system != nullptr) return;
    throw UsageError({.what = "the raster is not georeferenced",
                      .where = dataset.path().string(),
                      .expected = "a geotransform and a coordinate reference system",
                      .found = has_geotransform ? "no coordinate reference system" : "no geotransform",
                      .fix = "set them: gdal_edit.py -a_srs EPSG:… -a_ullr WEST NORTH EAST SOUTH FILE"});
  }

  void trace_outline() {
    constexpr int kSteps = 16;  // per side: edges are curves on the map
    const double width = dataset.size().width, height = dataset.size().height;
    std::vector<double> x, y;
    for (int side = 0; side < 4; ++side) {
      for (int i = 0; i < kSteps; ++i) {
        const double along = static_cast<double>(i) / kSteps;
        x.push_back(width * (side == 0 ? along : side == 1 ? 1 : side == 2 ? 1 - along : 0));
        y.push_back(height * (side == 0 ? 0 : side == 1 ? along : side == 2 ? 1 : 1 - along));
      }
    }
    std::vector<double> z(x.size());
    std::vector<int> ok(x.size());
    GDALGenImgProjTransform(transformer.get(), FALSE, static_cast<int>(x.size()), x.data(), y.data(), z.data(),
                            ok.data());
    for (std::size_t i = 0; i < x.size(); ++i) {
      if (ok[i] == 0 || !std::isfinite(x[i]) || !std::isfinite(y[i])) fail_transform();
      outline.push_back({x[i], y[i]});
    }
  }

  Nodes nodes_for(int zoom, const cv::Rect& block) const {
    Nodes nodes;
    nodes.columns = map_nodes_along(block.width);
    nodes.rows = map_nodes_along(block.height);
    const double pixel_m = mercator_pixel_m(zoom);
    for (int row = 0; row < nodes.rows; ++row) {
      for (int column = 0; column < nodes.columns; ++column) {
        nodes.x.push_back((block.x + column * kMapNodeStep_px + 0.5) * pixel_m - kMercatorHalfWorld_m);
        nodes.y.push_back(kMercatorHalfWorld_m - (block.y + row * kMapNodeStep_px + 0.5) * pixel_m);
      }
    }
    std::vector<double> z(nodes.x.size());
    std::vector<int> ok(nodes.x.size());
    GDALGenImgProjTransform(transformer.get(), TRUE, static_cast<int>(nodes.x.size()), nodes.x.data(), nodes.y.data(),
                            z.data(), ok.data());
    if (std::find(ok.begin(), ok.end(), 0) != ok.end()) fail_transform();
    const auto [left, right] = std::minmax_element(nodes.x.begin(), nodes.x.end());
    const auto [top, bottom] = std::minmax_element(nodes.y.begin(), nodes.y.end());
    nodes.bounds = {*left, *top, *right - *left, *bottom - *top};
    return nodes;
  }

  void read_block(int zoom, const cv::Rect& block, cv::Mat bgr, cv::Mat mask) const;

  struct Destroy {
    void operator()(void* transformer) const { GDALDestroyGenImgProjTransformer(transformer); }
  };
  GdalDataset dataset;
  std::unique_ptr<void, Destroy> transformer;
  std::vector<MercatorXY> outline;
};

namespace {

// A part of the raster in memory, averaged down when the map is coarser.
struct Part {
  MaskedImage image;
  cv::Point2d origin;  // raster pixels
  cv::Point2d scale;   // raster pixels per pixel of the part
};

std::optional<Part> read_part(const GdalDataset& dataset, const Nodes& nodes) {
  const int factor = std::max(1, static_cast<int>(std::floor(nodes.shrink() + 0.01)));
  const int margin = 2 * factor + 2;
  // Aligned to the factor, so that averages do not depend on where a block starts.
  const auto down = [&](double value) { return static_cast<int>(std::floor(value / factor)) * factor; };
  const cv::Rect raster({0, 0}, dataset.size());
  const auto clamped = [](double value, int limit) { return std::clamp(value, -1e6, limit + 1e6); };
  const int left = down(clamped(nodes.bounds.x, raster.width) - margin);
  const int top = down(clamped(nodes.bounds.y, raster.height) - margin);
  const int right = down(clamped(nodes.bounds.br().x, raster.width) + margin) + factor;
  const int bottom = down(clamped(nodes.bounds.br().y, raster.height) + margin) + factor;
  const cv::Rect window = cv::Rect(left, top, right - left, bottom - top) & raster;
  if (window.empty()) return std::nullopt;
  const cv::Size size((window.width + factor - 1) / factor, (window.height + factor - 1) / factor);
  Part part{dataset.read(window, size),
            {static_cast<double>(window.x), static_cast<double>(window.y)},
            {static_cast<double>(window.width) / size.width, static_cast<double>(window.height) / size.height}};
  return part;
}

// Less than two raster pixels per map pixel remain: a low-pass against aliasing. The kernel's variance is that of a
// triangle as wide as a map pixel, minus that of the interpolation itself; three taps have twice the outer tap as
// variance.
void blur_for(double shrink, cv::Mat& bgr) {
  if (shrink < 1.05) return;
  const double outer = std::min(0.25, (shrink * shrink - 1.0) / 12.0);
  const cv::Mat taps = (cv::Mat_<float>(3, 1) << outer, 1.0 - 2.0 * outer, outer);
  cv::sepFilter2D(bgr, bgr, CV_8U, taps, taps, {-1, -1}, 0, cv::BORDER_REPLICATE);
}

}  // namespace

void RasterSource::Impl::read_block(int zoom, const cv::Rect& block, cv::Mat bgr, cv::Mat mask) const {
  const Nodes nodes = nodes_for(zoom, block);
  const double width = dataset.size().width, height = dataset.size().height;
  const cv::Rect2d raster(0, 0, width, height);
  std::optional<Part> part;
  if ((nodes.bounds & raster).area() > 0) part = read_part(dataset, nodes);
  if (!part) {
    bgr.setTo(cv::Scalar::all(0));
    mask.setTo(0);
    return;
  }
  const bool whole = cv::countNonZero(part->image.mask) == part->image.mask.rows * part->image.mask.cols;
  if (!whole) fill_invalid(part->image);
  blur_for(nodes.shrink() / part->scale.x, part->image.bgr);

  // cv::remap uses pixel centres as integers, GDAL pixel corners.
  const cv::Mat map = positions_between_nodes(
      block.size(), [&](int row, int column) { return nodes.at(row, column); },
      [&](const cv::Point2d& begin, const cv::Point2d& end) -> NodeSegment {
        return {{static_cast<float>((begin.x - part->origin.x) / part->scale.x - 0.5),
                 static_cast<float>((begin.y - part->origin.y) / part->scale.y - 0.5)},
                {static_cast<float>((end.x - begin.x) / kMapNodeStep_px / part->scale.x),
                 static_cast<float>((end.y - begin.y) / kMapNodeStep_px / part->scale.y)}};
      });
  cv::remap(part->image.bgr, bgr, map, {}, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  if (whole) {
    mask.setTo(255);
  } else {
    cv::remap(part->image.mask, mask, map, {}, cv::INTER_NEAREST, cv::BORDER_REPLICATE);
  }
  const bool inside =
      nodes.bounds.x >= 0 && nodes.bounds.y >= 0 && nodes.bounds.br().x <= width && nodes.bounds.br().y <= height;
  if (inside) return;
  // Only positions on the raster itself are valid: its outermost pixels reach half a pixel beyond their centres.
  const auto left = static_cast<float>((0 - part->origin.x) / part->scale.x - 0.5);
  const auto top = static_cast<float>((0 - part->origin.y) / part->scale.y - 0.5);
  const auto right = static_cast<float>((width - part->origin.x) / part->scale.x - 0.5);
  const auto bottom = static_cast<float>((height - part->origin.y) / part->scale.y - 0.5);
  for (int row = 0; row < block.height; ++row) {
    const auto* positions = map.ptr<cv::Point2f>(row);
    auto* valid = mask.ptr<std::uint8_t>(row);
    for (int column = 0; column < block.width; ++column) {
      const cv::Point2f& p = positions[column];
      if (p.x < left || p.y < top || p.x >= right || p.y >= bottom) valid[column] = 0;
    }
  }
}

RasterSource::RasterSource(const std::filesystem::path& path, std::optional<Stretch> stretch)
    : impl_(std::make_unique<Impl>(path, stretch)) {}
RasterSource::~RasterSource() = default;
RasterSource::RasterSource(RasterSource&&) noexcept = default;
RasterSource& RasterSource::operator=(RasterSource&&) noexcept = default;

const std::vector<MercatorXY>& RasterSource::outline() const { return impl_->outline; }

double RasterSource::pixel_m() const {
  const std::vector<MercatorXY>& ring = impl_->outline;
  double doubled_m2 = 0, middle_m = 0;
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const MercatorXY& a = ring[i];
    const MercatorXY& b = ring[(i + 1) % ring.size()];
    doubled_m2 += a.x_m * b.y_m - b.x_m * a.y_m;
    middle_m += a.y_m / static_cast<double>(ring.size());
  }
  // The map is larger than the ground by the secant of the latitude, which is cosh(y / R).
  const double scale = std::cosh(middle_m / kMercatorRadius_m);
  const double pixels = static_cast<double>(impl_->dataset.size().width) * impl_->dataset.size().height;
  return std::sqrt(std::abs(doubled_m2) / 2 / pixels) / scale;
}
double RasterSource::place_precision_m() const {
  GDALDataset& dataset = *impl_->dataset.handle();
  const auto text = [&dataset](const char* name) {
    const char* value = dataset.GetMetadataItem(name);
    return std::string_view(value == nullptr ? "" : value);
  };
  const std::string_view coordinates = text("NITF_ICORDS");
  if (coordinates.empty() || text("NITF_BLOCKA_FRFC_LOC_01").size() > 10) return 0;
  for (const char* exact : {"RPFHDR", "GEOLOB"}) {  // CADRG and CIB, ECRG: the frame's place is exact
    if (dataset.GetMetadataItem(exact, "TRE") != nullptr) return 0;
  }
  std::filesystem::path beside = path();
  beside += ".aux.xml";
  if (std::filesystem::exists(beside) && read_text_file(beside).find("<GeoTransform>") != std::string::npos) return 0;
  constexpr double kDegree_m = 111'320;
  if (coordinates == "G" || coordinates == "C") return kDegree_m / 3600 / 2;
  return coordinates == "D" ? kDegree_m / 1000 / 2 : 0.5;  // else whole metres of UTM
}

const std::filesystem::path& RasterSource::path() const { return impl_->dataset.path(); }

MaskedImage RasterSource::read(int zoom, const cv::Rect& pixels) {
  const QuietGdal quiet;
  MaskedImage image;
  image.bgr.create(pixels.size(), CV_8UC3);
  image.mask.create(pixels.size(), CV_8UC1);
  for (int row = 0; row < pixels.height; row += kBlock) {
    for (int column = 0; column < pixels.width; column += kBlock) {
      const cv::Rect part(column, row, std::min(kBlock, pixels.width - column), std::min(kBlock, pixels.height - row));
      impl_->read_block(zoom, part + pixels.tl(), image.bgr(part), image.mask(part));
    }
  }
  return image;
}

}  // namespace nadir
