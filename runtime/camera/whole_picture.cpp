#include "camera/whole_picture.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <string>
#include <string_view>

namespace nadir {
namespace {

using namespace std::string_view_literals;

bool ends_with_mark(ByteView bytes, std::string_view mark) {
  constexpr std::size_t kPadding = 4096;  // some cameras round files up to whole blocks
  const std::string_view text = as_text(bytes);
  const std::string_view tail = text.substr(text.size() - std::min(text.size(), kPadding + mark.size()));
  const std::size_t at = tail.rfind(mark);
  if (at == std::string_view::npos) return false;
  return tail.find_first_not_of("\0\xff"sv, at + mark.size()) == std::string_view::npos;
}

bool is_whole_webp(ByteView bytes) {
  std::uint64_t size = 0;
  for (std::size_t i = 0; i < 4; ++i) size |= std::uint64_t{bytes[4 + i]} << (8 * i);
  return bytes.size() >= size + 8;
}

}  // namespace

bool is_whole_picture(ByteView bytes) {
  if (bytes.size() < 12) return false;
  const std::string_view text = as_text(bytes);
  if (text.starts_with("\xff\xd8\xff"sv)) return ends_with_mark(bytes, "\xff\xd9"sv);
  if (text.starts_with("\x89PNG\r\n\x1a\n"sv)) return ends_with_mark(bytes, "IEND\xae\x42\x60\x82"sv);
  if (text.starts_with("RIFF"sv) && text.substr(8).starts_with("WEBP"sv)) return is_whole_webp(bytes);
  return false;
}

bool has_picture_name(const std::filesystem::path& name) {
  const std::string file = name.filename();
  std::string extension = name.extension();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  constexpr std::array kKnown{".jpg"sv, ".jpeg"sv, ".png"sv, ".webp"sv};
  return !file.starts_with('.') && std::find(kKnown.begin(), kKnown.end(), extension) != kKnown.end();
}

}  // namespace nadir
