// Writes flights as their ground stations would send them, for tests and figures that talk to a running service:
//   OUT/root.json, OUT/root.key.pem, OUT/ground-1.token, and for each flight OUT/flight-N/: batch-M.json, M-K.pack
// and, of its first thousand tiles, as it leaves the aircraft: candidates/, with tile.key.pem
// Images repeat after some hundred places, and a comment in each JPEG makes its bytes unique: drawing and encoding
// every one would take longer than the measurement itself.
// usage: make_flights OUT FLIGHTS TILES [UNIX_TIME]
#include <fmt/format.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iostream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "candidates/flight_maker.hpp"
#include "imagery/codecs.hpp"
#include "trust/installed_report.hpp"

namespace nadir::test {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kTilesOfBatch = 1000;
constexpr std::size_t kPictures = 256;

// All tiles as a square.
TileKey place(std::size_t number, std::size_t tiles) {
  const auto n = static_cast<std::uint32_t>(number);
  const auto columns = static_cast<std::uint32_t>(std::ceil(std::sqrt(static_cast<double>(tiles))));
  return {18, 137'000 + n % columns, 91'000 + n / columns};
}

// A flight's tiles, by their number.
class TileStock {
 public:
  TileStock(const FlightMaker& flight, std::size_t tiles) : flight_(flight), tiles_(tiles) {
    for (std::size_t i = 0; i < std::min(tiles, kPictures); ++i) {
      pictures_.push_back(encode_image(flight.picture(place(i, tiles)), ImageFormat::jpeg, 85));
    }
  }

  Candidate candidate(std::size_t number) const {
    const TileKey at = place(number, tiles_);
    const Bytes& picture = pictures_[number % pictures_.size()];
    const std::string comment = to_text(at);
    const auto length = static_cast<std::uint8_t>(comment.size() + 2);
    Bytes tile(picture.begin(), picture.begin() + 2);  // the start of image
    tile.insert(tile.end(), {0xff, 0xfe, 0, length});
    tile.insert(tile.end(), comment.begin(), comment.end());
    tile.insert(tile.end(), picture.begin() + 2, picture.end());
    return flight_.encoded_candidate(at, std::move(tile));
  }

 private:
  const FlightMaker& flight_;
  std::size_t tiles_;
  std::vector<Bytes> pictures_;
};

// Not to outlive a loss of power: it can be made again.
void write_plain(const fs::path& path, ByteView bytes) {
  std::ofstream out(path, std::ios::binary);
  out.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  if (!out.flush()) throw Error({.what = "cannot write", .where = path.string()});
}

void write_batch(const FlightMaker& flight, const TileStock& stock, const fs::path& folder, std::size_t number,
                 std::size_t first, std::size_t end, int batch) {
  std::vector<Candidate> candidates;
  for (std::size_t i = first; i < end; ++i) candidates.push_back(stock.candidate(i));
  write_plain(folder / fmt::format("batch-{}.json", number), as_bytes(flight.batch(candidates, batch).json()));
  std::size_t packed = 0;
  for (int pack = 0; packed < candidates.size(); ++pack) {
    std::vector<PackEntry> entries;
    for (std::size_t i = packed; i < candidates.size(); ++i) {
      entries.push_back({candidates[i].sidecar.sha256, static_cast<std::uint32_t>(candidates[i].tile.size())});
    }
    const std::size_t taken = entries_of_next_pack(entries);
    const auto begin = candidates.begin() + static_cast<std::ptrdiff_t>(packed);
    const Bytes bytes = pack_of({begin, begin + static_cast<std::ptrdiff_t>(taken)});
    write_plain(folder / fmt::format("{}-{}.pack", number, pack), bytes);
    packed += taken;
  }
}

void write_store(const FlightMaker& flight, const TileStock& stock, const fs::path& folder, std::size_t tiles) {
  std::vector<Candidate> candidates;
  for (std::size_t i = 0; i < std::min(tiles, kTilesOfBatch); ++i) candidates.push_back(stock.candidate(i));
  CandidateStore store(folder / "candidates");
  store.put(candidates);
  store.close();
  const InstalledReport report{.airframe = flight.options().airframe,
                               .number = 1,
                               .reported_at = flight.options().captured_at,
                               .package = flight.options().base_package,
                               .series = "valley",
                               .sequence = 3,
                               .root_version = 1,
                               .verified_at = flight.options().captured_at};
  write_file_atomic(folder / "candidates" / kInstalledFile, sign_installed_report(report, flight.key()).json());
  write_file_atomic(folder / "tile.key.pem", flight.key().pem(), 0600);
}

void make(const fs::path& out, int flights, std::size_t tiles, UtcTime at) {
  std::vector<FlightMaker> makers;
  for (int number = 1; number <= flights; ++number) {
    makers.emplace_back(FlightOptions{.airframe = fmt::format("mini-{:02}", number),
                                      .flight = fmt::format("flight-{}", number),
                                      .captured_at = {at.unix_s - 3600},
                                      .noise = static_cast<std::uint64_t>(number)});
  }
  std::vector<const FlightMaker*> all;
  for (const FlightMaker& maker : makers) all.push_back(&maker);
  fs::create_directories(out);
  const PrivateKey root = PrivateKey::generate();
  write_file_atomic(out / "root.json", root_text(all, root, 1, {}, {at.unix_s + 365 * kDay_s}));
  write_file_atomic(out / "root.key.pem", root.pem(), 0600);
  write_file_atomic(out / "ground-1.token", std::string_view("0123456789abcdef0123456789abcdef\n"), 0600);
  int batches = 0;
  for (int number = 1; number <= flights; ++number) {
    const fs::path folder = out / fmt::format("flight-{}", number);
    fs::create_directories(folder);
    const FlightMaker& maker = makers[static_cast<std::size_t>(number - 1)];
    const TileStock stock(maker, tiles);
    write_store(maker, stock, folder, tiles);
    for (std::size_t first = 0; first < tiles; first += kTilesOfBatch) {
      write_batch(maker, stock, folder, first / kTilesOfBatch, first, std::min(first + kTilesOfBatch, tiles),
                  ++batches);
    }
  }
}

}  // namespace
}  // namespace nadir::test

int main(int argc, char** argv) {
  if (argc < 4) {
    std::cerr << "usage: make_flights OUT FLIGHTS TILES [UNIX_TIME]\n";
    return 2;
  }
  try {
    const nadir::UtcTime at =
        argc > 4 ? nadir::UtcTime{std::strtoll(argv[4], nullptr, 10)} : nadir::SystemClock().now();
    nadir::test::make(argv[1], std::atoi(argv[2]), static_cast<std::size_t>(std::atoll(argv[3])), at);
    return 0;
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 2;
  }
}
