#include "provision/board_pictures.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "imagery/codecs.hpp"
#include "replay/pictures.hpp"

namespace nadir {
namespace {

constexpr int kFewestCorners = 3;
constexpr int kMostCorners = 50;

bool read_count(std::string_view text, int& count) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), count);
  return error == std::errc{} && end == text.data() + text.size() && count >= kFewestCorners && count <= kMostCorners;
}

std::vector<std::filesystem::path> pictures_of(const std::filesystem::path& folder) {
  if (!std::filesystem::is_directory(folder)) {
    throw UsageError({.what = "the pictures cannot be read",
                      .where = folder,
                      .expected = "a folder with pictures of a checkerboard",
                      .found = std::filesystem::exists(folder) ? "a file" : "nothing"});
  }
  std::vector<std::filesystem::path> pictures;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.is_regular_file() && has_picture_extension(entry.path())) pictures.push_back(entry.path());
  }
  if (pictures.empty()) {
    throw UsageError({.what = "there are no pictures in this folder",
                      .where = folder,
                      .expected = "JPEG or PNG files of a checkerboard",
                      .found = "none"});
  }
  std::ranges::sort(pictures);
  return pictures;
}

void look_at(const std::filesystem::path& path, const Board& board, BoardPictures& result) {
  cv::Mat grey;
  try {
    grey = read_image_file(path, Colour::grey);
  } catch (const Error& error) {
    result.set_aside.push_back({path.filename(), "damaged: " + error.text().what});
    return;
  }
  if (result.size.empty()) result.size = grey.size();
  if (grey.size() != result.size) {
    throw UsageError({.what = "the pictures are not all of one size",
                      .where = path,
                      .expected = fmt::format("{} x {} pixels, as the first", result.size.width, result.size.height),
                      .found = fmt::format("{} x {}", grey.cols, grey.rows),
                      .fix = "give pictures of one camera in one mode, the one that it flies with"});
  }
  auto view = find_board(grey, board, path.filename());
  if (!view) {
    result.set_aside.push_back(
        {path.filename(), fmt::format("no whole board of {} x {} inner corners", board.columns, board.rows)});
  } else if (!(view->edge_width_px <= kMaxEdgeWidth_px)) {
    result.set_aside.push_back(
        {path.filename(), fmt::format("blurred: edges are {:.1f} pixels wide, at most {:.0f} wanted",
                                      view->edge_width_px, kMaxEdgeWidth_px)});
  } else {
    result.views.push_back(std::move(*view));
  }
}

// The finder places corners by a model of a flat, undistorted neighbourhood, which is off by 0.1 px where the board is
// tilted or the lens bends it: enough to make a focal length wrong by 0.8 %. Gradients around each corner are not.
void refine(const cv::Mat& grey, std::vector<cv::Point2f>& corners) {
  double spacing_px = cv::norm(corners[1] - corners[0]);
  for (std::size_t i = 1; i < corners.size(); ++i) {
    spacing_px = std::min(spacing_px, cv::norm(corners[i] - corners[i - 1]));
  }
  const int reach = std::clamp(static_cast<int>(spacing_px / 4), 2, 5);  // stays away from the neighbours
  cv::cornerSubPix(grey, corners, {reach, reach}, {-1, -1},
                   {cv::TermCriteria::EPS + cv::TermCriteria::COUNT, 50, 1e-4});
}

}  // namespace

Board parse_board(std::string_view text, double square_m) {
  Board board{.square_m = square_m};
  const std::size_t cross = text.find('x');
  const bool reads = cross != std::string_view::npos && read_count(text.substr(0, cross), board.columns) &&
                     read_count(text.substr(cross + 1), board.rows);
  if (!reads) {
    throw UsageError({.what = "the board cannot be read",
                      .where = "--board",
                      .expected = fmt::format("inner corners across and down, each from {} to {}, such as 9x6",
                                              kFewestCorners, kMostCorners),
                      .found = std::string(text)});
  }
  if (board.columns % 2 == board.rows % 2) {
    throw UsageError({.what = "this board looks the same when it is turned round",
                      .where = "--board",
                      .expected = "an odd number of inner corners one way and an even one the other, such as 9x6",
                      .found = std::string(text)});
  }
  return board;
}

std::optional<BoardView> find_board(const cv::Mat& grey, const Board& board, std::string picture) {
  const cv::Size pattern(board.columns, board.rows);
  BoardView view{.picture = std::move(picture)};
  if (!cv::findChessboardCornersSB(grey, pattern, view.corners, cv::CALIB_CB_ACCURACY | cv::CALIB_CB_NORMALIZE_IMAGE)) {
    return std::nullopt;
  }
  refine(grey, view.corners);
  view.edge_width_px = cv::estimateChessboardSharpness(grey, pattern, view.corners)[0];
  return view;
}

BoardPictures find_boards(const std::filesystem::path& folder, const Board& board, Progress& progress) {
  const auto pictures = pictures_of(folder);
  BoardPictures result;
  progress.begin("looking for the board", pictures.size(), "pictures");
  for (const auto& picture : pictures) {
    look_at(picture, board, result);
    progress.advance();
  }
  progress.end();
  return result;
}

}  // namespace nadir
