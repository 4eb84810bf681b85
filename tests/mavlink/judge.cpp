#include "mavlink/judge.hpp"

#include <sstream>
#include <stdexcept>

#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir::test {
namespace {

std::vector<std::string> judged(const std::string& job, const std::string& options, const std::string& input) {
  const TemporaryFolder folder;
  const auto file = folder.write("input", input);
  const ProcessResult result =
      run_shell(std::string(NADIR_PYTHON) + " " NADIR_JUDGE " " + job + " " + options + " < " + file.string());
  if (result.code != 0) throw std::runtime_error("judge.py " + job + ": " + result.err);
  std::vector<std::string> lines;
  std::istringstream out(result.out);
  for (std::string line; std::getline(out, line);) lines.push_back(line);
  return lines;
}

}  // namespace

std::string hex(ByteView bytes) {
  std::string text;
  for (const std::uint8_t byte : bytes) {
    text += "0123456789abcdef"[byte >> 4];
    text += "0123456789abcdef"[byte & 15];
  }
  return text;
}

Bytes from_hex(std::string_view text) {
  Bytes bytes;
  for (std::size_t i = 0; i + 1 < text.size(); i += 2) {
    bytes.push_back(static_cast<std::uint8_t>(std::stoi(std::string(text.substr(i, 2)), nullptr, 16)));
  }
  return bytes;
}

std::vector<Bytes> frames_by_pymavlink(const std::string& messages, const std::string& options) {
  std::vector<Bytes> frames;
  for (const std::string& line : judged("write", options, messages)) frames.push_back(from_hex(line));
  return frames;
}

std::vector<nlohmann::json> read_by_pymavlink(const std::vector<Bytes>& frames, const std::string& options) {
  std::string input;
  for (const Bytes& frame : frames) input += hex(frame) + "\n";
  std::vector<nlohmann::json> read;
  for (const std::string& line : judged("read", options, input)) read.push_back(nlohmann::json::parse(line));
  return read;
}

}  // namespace nadir::test
