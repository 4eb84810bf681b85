#include "raster/zarr_raster.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gdal_priv.h>

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "base/error.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using Array = std::shared_ptr<GDALMDArray>;

[[noreturn]] void refuse(const fs::path& folder, std::string expected, std::string found) {
  throw Error({.what = "this Zarr store cannot be read as one raster",
               .where = folder.string(),
               .expected = std::move(expected),
               .found = std::move(found),
               .fix = "write the bands that are wanted to a GeoTIFF: gdal_translate 'ZARR:\"FOLDER\":/ARRAY' OUT.tif"});
}

bool is_one_of(std::string name, std::initializer_list<std::string_view> names) {
  std::transform(name.begin(), name.end(), name.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; });
  return std::find(names.begin(), names.end(), name) != names.end();
}

// Which dimensions are columns and rows.
struct Axes {
  std::size_t x = 0, y = 0;
};

std::optional<Axes> axes_of(GDALMDArray& array) {
  const auto& dimensions = array.GetDimensions();
  std::optional<std::size_t> x, y;
  for (std::size_t i = 0; i < dimensions.size(); ++i) {
    const std::string& name = dimensions[i]->GetName();
    if (is_one_of(name, {"x", "lon", "longitude", "easting"})) x = i;
    if (is_one_of(name, {"y", "lat", "latitude", "northing"})) y = i;
  }
  if (!x || !y) return std::nullopt;
  return Axes{*x, *y};
}

bool same_dimensions(GDALMDArray& a, GDALMDArray& b) {
  const auto &first = a.GetDimensions(), &second = b.GetDimensions();
  return std::equal(first.begin(), first.end(), second.begin(), second.end(),
                    [](const auto& one, const auto& other) { return one->GetFullName() == other->GetFullName(); });
}

// Names end in a number, or do not: Band2 before Band10.
bool in_counting_order(const Array& a, const Array& b) {
  const std::string &first = a->GetName(), &second = b->GetName();
  return first.size() != second.size() ? first.size() < second.size() : first < second;
}

// The arrays that are the image, in the order of its bands.
std::vector<Array> image_arrays(const fs::path& folder, GDALGroup& root) {
  std::vector<Array> planes, cubes;
  std::vector<std::string> names;
  for (const std::string& name : root.GetMDArrayNames()) {
    Array array = root.OpenMDArray(name);
    if (!array || array->GetDataType().GetClass() != GEDTC_NUMERIC || !axes_of(*array)) continue;
    if (array->GetDimensionCount() == 2) planes.push_back(array);
    if (array->GetDimensionCount() == 3) cubes.push_back(array);
    names.push_back(name);
  }
  if (cubes.size() == 1) return cubes;
  std::sort(planes.begin(), planes.end(), in_counting_order);
  const bool alike = std::all_of(planes.begin(), planes.end(),
                                 [&](const Array& array) { return same_dimensions(*array, *planes.front()); });
  const auto named = [&planes](std::string_view name) {
    return std::find_if(planes.begin(), planes.end(),
                        [name](const Array& array) { return is_one_of(array->GetName(), {name}); });
  };
  if (cubes.empty() && alike) {
    const std::array colours = {named("red"), named("green"), named("blue")};
    if (std::count(colours.begin(), colours.end(), planes.end()) == 0) return {*colours[0], *colours[1], *colours[2]};
    const bool counted = std::all_of(planes.begin(), planes.end(),
                                     [](const Array& array) { return array->GetName().starts_with("Band"); });
    if (planes.size() == 1 || (!planes.empty() && counted)) return planes;
  }
  std::sort(names.begin(), names.end());
  refuse(folder, "one array of bands, y and x; or arrays of y and x: one, red, green and blue, or Band1, Band2, …",
         names.empty() ? "no array with dimensions x and y" : fmt::format("{}", fmt::join(names, ", ")));
}

std::size_t chunk_files_of(const fs::path& array) {
  std::size_t count = 0;
  for (const auto& entry : fs::recursive_directory_iterator(array)) {
    const std::string name = entry.path().filename().string();
    if (entry.is_regular_file() && !name.starts_with('.') && name != "zarr.json") ++count;
  }
  return count;
}

void require_all_chunks(const fs::path& folder, GDALMDArray& array) {
  if (array.GetRawNoDataValue() != nullptr) return;
  const std::vector<GUInt64> block = array.GetBlockSize();
  std::uint64_t expected = 1;
  for (std::size_t i = 0; i < block.size(); ++i) {
    const std::uint64_t size = array.GetDimensions()[i]->GetSize();
    expected *= block[i] == 0 ? 1 : (size + block[i] - 1) / block[i];
  }
  const fs::path path = array.GetName().empty() ? folder : folder / array.GetName();
  const std::size_t found = chunk_files_of(path);
  if (found >= expected) return;
  throw Error({.what = "chunks of a Zarr array are missing, and it states no fill value",
               .where = path.string(),
               .expected = fmt::format("{} files", expected),
               .found = std::to_string(found),
               .fix = "copy the folder again; or state its fill_value, if there is no ground"});
}

// A band of an array, as a band of the image.
class ZarrBand final : public GDALRasterBand {
 public:
  ZarrBand(GDALDataset& image, int number, GDALRasterBand& source, GDALColorInterp colour)
      : source_(source), colour_(colour) {
    poDS = &image;
    nBand = number;
    eDataType = source.GetRasterDataType();
    source.GetBlockSize(&nBlockXSize, &nBlockYSize);
  }
  GDALColorInterp GetColorInterpretation() override { return colour_; }
  double GetNoDataValue(int* there) override { return source_.GetNoDataValue(there); }

 private:
  CPLErr IReadBlock(int column, int row, void* target) override { return source_.ReadBlock(column, row, target); }

  GDALRasterBand& source_;
  GDALColorInterp colour_;
};

class ZarrImage final : public GDALDataset {
 public:
  explicit ZarrImage(std::vector<GdalHandle> arrays) : arrays_(std::move(arrays)) {
    nRasterXSize = arrays_[0]->GetRasterXSize(), nRasterYSize = arrays_[0]->GetRasterYSize();
    if (const OGRSpatialReference* system = arrays_[0]->GetSpatialRef()) {
      system_ = *system;
      system_.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);  // GDAL 3.6 says that the first axis is the rows'
    }
    std::vector<GDALRasterBand*> sources;
    for (const GdalHandle& array : arrays_) {
      for (int i = 1; i <= array->GetRasterCount(); ++i) sources.push_back(array->GetRasterBand(i));
    }
    static constexpr std::array kFirst = {GCI_RedBand, GCI_GreenBand, GCI_BlueBand};
    for (std::size_t i = 0; i < sources.size(); ++i) {
      const GDALColorInterp colour = sources.size() < 3 ? GCI_GrayIndex : i < 3 ? kFirst[i] : GCI_Undefined;
      const int number = static_cast<int>(i) + 1;
      SetBand(number, new ZarrBand(*this, number, *sources[i], colour));  // the dataset's from now on
    }
  }
  CPLErr GetGeoTransform(double* transform) override { return arrays_[0]->GetGeoTransform(transform); }
  const OGRSpatialReference* GetSpatialRef() const override { return system_.IsEmpty() ? nullptr : &system_; }

 private:
  std::vector<GdalHandle> arrays_;
  OGRSpatialReference system_;
};

}  // namespace

bool is_zarr(const fs::path& path) {
  std::error_code code;
  if (!fs::is_directory(path, code)) return false;
  constexpr std::array kMarks = {".zgroup", ".zarray", ".zmetadata", "zarr.json"};
  return std::any_of(kMarks.begin(), kMarks.end(), [&](const char* mark) { return fs::exists(path / mark, code); });
}

GdalHandle open_zarr(const fs::path& folder) {
  const QuietGdal quiet;
  static constexpr std::array kDriver = {"Zarr", static_cast<const char*>(nullptr)};
  const GdalHandle store(GDALDataset::Open(folder.c_str(), GDAL_OF_MULTIDIM_RASTER | GDAL_OF_READONLY, kDriver.data()));
  const std::shared_ptr<GDALGroup> root = store ? store->GetRootGroup() : nullptr;
  if (!root) refuse(folder, "Zarr, version 2", QuietGdal::last_error());
  std::vector<GdalHandle> arrays;
  for (const Array& array : image_arrays(folder, *root)) {
    require_all_chunks(folder, *array);
    const Axes axes = axes_of(*array).value();
    GdalHandle plane(array->AsClassicDataset(axes.x, axes.y));
    if (!plane) refuse(folder, "an array that GDAL reads as bands", QuietGdal::last_error());
    arrays.push_back(std::move(plane));
  }
  auto image = std::make_unique<ZarrImage>(std::move(arrays));
  image->SetDescription(folder.c_str());
  return GdalHandle(image.release());
}

std::vector<fs::path> files_of_zarr(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace nadir
