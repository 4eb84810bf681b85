#include "imagery/frame_image.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/input_file.hpp"
#include "imagery/tiff.hpp"
#include "imagery/tiff_memory.hpp"

namespace nadir {
namespace {

constexpr std::uint64_t kMaxFrameFile = std::uint64_t{1} << 30;
constexpr std::size_t kFrameHeaderBytes = std::size_t{1} << 18;  // enough for the header of nearly every image

std::string lower_extension(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

[[noreturn]] void reject_tiff(std::string_view name, std::string found) {
  throw Error({.what = "cannot decode the image",
               .where = std::string(name),
               .expected = "a complete TIFF image of 8 or 16 bits per sample, grey or colour",
               .found = found.empty() ? "another kind of TIFF" : std::move(found),
               .fix = "copy the file again, or convert it to JPEG"});
}

FrameSize tiff_size(const RandomBytes& bytes, std::string_view name) {
  try {
    const TiffFile file(bytes, std::string(name));
    const std::uint64_t width = file.number(0, tiff::kWidth, 0), height = file.number(0, tiff::kHeight, 0);
    if (width < 1 || height < 1 || width > kMaxImageSide || height > kMaxImageSide ||
        width * height > static_cast<std::uint64_t>(kMaxImagePixels)) {
      reject_tiff(name, fmt::format("{} x {} pixels", width, height));
    }
    return {static_cast<int>(width), static_cast<int>(height)};
  } catch (const TiffError& error) {
    reject_tiff(name, error.text().found);
  }
}

cv::Mat decode_tiff(ByteView bytes, Colour colour, std::string_view name, int shrink) {
  const FrameSize size = tiff_size(MemoryBytes(bytes), name);
  constexpr tmsize_t kMaxAllocation = tmsize_t{1} << 31;  // a strip may be the whole image
  TiffMemory memory{bytes};
  const TiffHandle tiff = open_tiff(memory, "frame", kMaxAllocation);
  if (!tiff) reject_tiff(name, memory.complaint);
  std::uint16_t bits = 0;
  TIFFGetFieldDefaulted(tiff.get(), TIFFTAG_BITSPERSAMPLE, &bits);
  if (bits > 16) reject_tiff(name, fmt::format("{} bits per sample", bits));
  std::array<char, 1024> why{};
  if (TIFFRGBAImageOK(tiff.get(), why.data()) == 0) reject_tiff(name, why.data());
  cv::Mat rgba(size.height, size.width, CV_8UC4);
  const int read = TIFFReadRGBAImageOriented(tiff.get(), static_cast<std::uint32_t>(size.width),
                                             static_cast<std::uint32_t>(size.height),
                                             reinterpret_cast<std::uint32_t*>(rgba.data), ORIENTATION_TOPLEFT, 1);
  if (read == 0 || !memory.complaint.empty()) reject_tiff(name, memory.complaint);
  cv::Mat image;
  cv::cvtColor(rgba, image, colour == Colour::grey ? cv::COLOR_RGBA2GRAY : cv::COLOR_RGBA2BGR);
  if (shrink == 1) return image;
  cv::Mat reduced;
  cv::resize(image, reduced, {(image.cols + shrink - 1) / shrink, (image.rows + shrink - 1) / shrink}, 0, 0,
             cv::INTER_AREA);
  return reduced;
}

}  // namespace

bool has_frame_extension(const std::filesystem::path& path) {
  constexpr std::array kKnown{".jpg", ".jpeg", ".png", ".tif", ".tiff"};
  return std::find(kKnown.begin(), kKnown.end(), lower_extension(path)) != kKnown.end();
}

bool has_heic_extension(const std::filesystem::path& path) {
  const std::string extension = lower_extension(path);
  return extension == ".heic" || extension == ".heif" || extension == ".hif";
}

bool is_tiff(ByteView bytes) {
  using namespace std::string_view_literals;
  if (bytes.size() < 4) return false;
  const std::string_view magic = as_text(bytes.first(4));
  return magic == "II*\0"sv || magic == "MM\0*"sv || magic == "II+\0"sv || magic == "MM\0+"sv;
}

bool is_complete_tiff(ByteView bytes) {
  constexpr std::uint16_t kStripOffsets = 273, kStripSizes = 279, kTileOffsets = 324, kTileSizes = 325;
  constexpr std::uint64_t kMaxParts = 1 << 20;
  try {
    const MemoryBytes memory(bytes);
    const TiffFile file(memory, "frame");
    const bool strips = file.has(0, kStripOffsets);
    const auto offsets = file.numbers(0, strips ? kStripOffsets : kTileOffsets, kMaxParts);
    const auto sizes = file.numbers(0, strips ? kStripSizes : kTileSizes, kMaxParts);
    if (offsets.empty() || offsets.size() != sizes.size()) return false;
    for (std::size_t i = 0; i < offsets.size(); ++i) {
      if (offsets[i] > bytes.size() || sizes[i] > bytes.size() - offsets[i]) return false;
    }
    return true;
  } catch (const TiffError&) {
    return false;
  }
}

bool is_heic(ByteView bytes) {
  constexpr std::array<std::string_view, 8> kBrands{"heic", "heix", "heim", "heis", "hevc", "hevx", "mif1", "msf1"};
  if (bytes.size() < 12 || as_text(bytes.subspan(4, 4)) != "ftyp") return false;
  return std::find(kBrands.begin(), kBrands.end(), as_text(bytes.subspan(8, 4))) != kBrands.end();
}

void reject_heic(std::string_view where) {
  throw UsageError({.what = "HEIC is not supported: convert to JPEG",
                    .where = std::string(where),
                    .expected = "JPEG, PNG or TIFF",
                    .found = "HEIC",
                    .fix = "set the camera to JPEG, or convert with: heif-convert -q 95 IN.heic OUT.jpg"});
}

FrameSize read_frame_size(ByteView bytes, std::string_view name) {
  if (is_heic(bytes)) reject_heic(name);
  if (is_tiff(bytes)) return tiff_size(MemoryBytes(bytes), name);
  const ImageInfo info = read_image_info(bytes, name);
  return {info.width, info.height};
}

FrameSize read_frame_size(const std::filesystem::path& path) {
  InputFile file(path);
  Bytes head(std::min<std::uint64_t>(kFrameHeaderBytes, file.size()));
  file.read_at(0, head);
  if (is_tiff(head)) return tiff_size(FileBytes(std::move(file)), path.string());  // its directory may be at the end
  try {
    return read_frame_size(head, path.string());
  } catch (const UsageError&) {
    throw;
  } catch (const Error&) {
    if (head.size() < kFrameHeaderBytes) throw;
    return read_frame_size(file.read(kMaxFrameFile), path.string());
  }
}

cv::Mat decode_frame(ByteView bytes, Colour colour, std::string_view name, int shrink, const DecodeBudget& budget) {
  if (is_heic(bytes)) reject_heic(name);
  if (!is_tiff(bytes)) return decode_image(bytes, colour, name, shrink, budget).image;
  if (shrink != 1 && shrink != 2 && shrink != 4 && shrink != 8) {
    throw UsageError({.what = "images can be reduced by 1, 2, 4 or 8", .found = std::to_string(shrink)});
  }
  return decode_tiff(bytes, colour, name, shrink);
}

cv::Mat read_frame_file(const std::filesystem::path& path, Colour colour, int shrink) {
  return decode_frame(read_file(path, kMaxFrameFile), colour, path.string(), shrink);
}

}  // namespace nadir
