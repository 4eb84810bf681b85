// Pictures of a checkerboard, and where its inner corners appear in each of them.
//
// A picture that does not help is set aside with its reason: no whole board, damaged, blurred. A picture of another
// size than the first is an Error, because it is of another camera or mode.
#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/progress.hpp"

namespace nadir {

struct Board {
  int columns = 0;  // inner corners, where four squares meet
  int rows = 0;
  double square_m = 0;
};

// "9x6". Throws UsageError unless both are from 3 to 50 and one is odd, the other even: else the board looks the same
// turned by half a circle.
Board parse_board(std::string_view text, double square_m);

struct BoardView {
  std::string picture;
  std::vector<cv::Point2f> corners{};  // pixels, row by row
  double edge_width_px = 0;            // from dark to bright, 10 % to 90 %: a sharp picture has 1 to 3
};

struct SetAside {
  std::string picture;
  std::string reason;
};

struct BoardPictures {
  cv::Size size;
  std::vector<BoardView> views{};
  std::vector<SetAside> set_aside{};
};

// Edges wider than this are blurred: the lens out of focus, or the board in motion.
inline constexpr double kMaxEdgeWidth_px = 5;

// The corners of one grey picture; nullopt: the whole board is not seen.
std::optional<BoardView> find_board(const cv::Mat& grey, const Board& board, std::string picture);

// Every JPEG and PNG of the folder, by name. Throws UsageError when there is none.
BoardPictures find_boards(const std::filesystem::path& folder, const Board& board, Progress& progress);

}  // namespace nadir
