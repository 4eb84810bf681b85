// nadir flight geotag: positions of a replay written into copies of the photos, and a table with UTC.
#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>

#include "base/csv.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "base/printable.hpp"
#include "base/time.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "flight_import/photo_metadata.hpp"
#include "flight_import/photo_position.hpp"

namespace nadir {
namespace {

struct PlacedPhoto {
  std::string name;
  LonLat place;
  double sigma_m = 0;
  std::string source;
};

// A name of a file in the folder: no path that leads out of it.
bool plain_name(const std::string& name) {
  return !name.empty() && name != "." && name != ".." && name.find('/') == std::string::npos;
}

// The rows that have a position.
std::vector<PlacedPhoto> read_positions(const std::filesystem::path& path, std::size_t& rows) {
  const CsvTable table = CsvTable::read(path);
  const std::size_t frame = table.required_column("frame"), lat = table.required_column("lat_deg"),
                    lon = table.required_column("lon_deg"), sigma = table.required_column("sigma_m"),
                    source = table.required_column("source");
  rows = table.rows();
  std::vector<PlacedPhoto> photos;
  for (std::size_t row = 0; row < table.rows(); ++row) {
    const auto lat_deg = table.number(row, lat), lon_deg = table.number(row, lon), sigma_m = table.number(row, sigma);
    if (!lat_deg || !lon_deg || !sigma_m) continue;
    const bool possible = std::abs(*lat_deg) <= 90 && std::abs(*lon_deg) <= 180 && *sigma_m >= 0;
    if (!possible || !plain_name(table.cell(row, frame))) {
      throw UsageError({.what = "a row is no position of a frame",
                        .where = fmt::format("{}:{}", path.string(), table.line_of(row)),
                        .expected = "a file's name, a latitude, a longitude and a sigma_m of 0 or more",
                        .found = printable(table.cell(row, frame)),
                        .fix = "give estimates.csv or refined.csv of a nadir replay"});
    }
    photos.push_back({table.cell(row, frame), {*lon_deg, *lat_deg}, *sigma_m, table.cell(row, source)});
  }
  return photos;
}

// UTC of the exposure where the photo knows it; not its wall clock of an unknown zone.
std::string utc_of(const std::filesystem::path& photo) {
  const PhotoFacts facts = read_photo_facts(photo);
  std::optional<double> utc_s = facts.utc_s;
  if (facts.camera_s && facts.zone_s) utc_s = *facts.camera_s - *facts.zone_s;
  if (!utc_s) return {};
  return to_rfc3339(UtcMillis{std::llround(*utc_s * 1000)});
}

class FlightGeotagCommand final : public Command {
 public:
  std::string_view group() const override { return "flight"; }
  std::string_view name() const override { return "geotag"; }
  std::string_view summary() const override { return "write a replay's positions into copies of the photos"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path frames_, estimates_, out_;
  double max_sigma_m_ = 20;
};

std::string_view FlightGeotagCommand::details() const {
  return R"(OUT receives copies of the photos with EXIF GPS tags (position, datum, and the radius of 68 % of
errors), and positions.csv with UTC. The photos themselves are never changed. Photos without a
position, or with a less certain one than --max-sigma-m, are left out: a photo in OUT has a position
that can be used.

Exit codes: 0 written, 1 no photo has a position of that accuracy, 2 an input is missing or invalid.)";
}

std::string_view FlightGeotagCommand::examples() const {
  return R"(nadir flight geotag --frames flight/frames --estimates result/refined.csv --out geotagged
nadir flight geotag --frames flight/frames --estimates result/refined.csv --max-sigma-m 5 --out geotagged)";
}

void FlightGeotagCommand::setup(Options& options) {
  options.value("--frames", frames_, "DIR", "folder with the photos").required();
  options.value("--estimates", estimates_, "FILE.csv", "refined.csv or estimates.csv of a nadir replay").required();
  options.value("--out", out_, "OUT", "folder to create; must not exist").required();
  options.value("--max-sigma-m", max_sigma_m_, "METRES", "largest 1-σ error per axis of a position that is written")
      .between(0.01, 100'000);
}

int FlightGeotagCommand::run(Context& context) {
  std::size_t rows = 0;
  const std::vector<PlacedPhoto> placed = read_positions(estimates_, rows);
  StagingDirectory staging(out_);
  std::string table = "photo,utc,lat_deg,lon_deg,sigma_m,radius_68_m,source\n";
  std::size_t written = 0;
  context.progress.begin("geotag", placed.size(), "photos");
  for (const PlacedPhoto& photo : placed) {
    context.progress.advance(1);
    if (photo.sigma_m > max_sigma_m_) continue;
    const std::filesystem::path original = frames_ / photo.name, copy = staging.path() / photo.name;
    if (!std::filesystem::is_regular_file(original)) {
      throw UsageError({.what = "the estimates name a photo that is not there",
                        .where = original.string(),
                        .expected = "the folder of frames that was replayed",
                        .fix = "give that folder as --frames"});
    }
    write_file_atomic(copy, ByteView(read_file(original)));
    write_photo_position(copy, {photo.place, photo.sigma_m});
    table +=
        fmt::format("{},{},{:.8f},{:.8f},{:.3f},{:.3f},{}\n", csv_cell(photo.name), utc_of(copy), photo.place.lat_deg,
                    photo.place.lon_deg, photo.sigma_m, radius_68_m(photo.sigma_m), photo.source);
    ++written;
  }
  context.progress.end();
  if (context.json) {
    print_json(context.out, {{"photos", rows}, {"positions", placed.size()}, {"written", written}});
  } else {
    print_figures(context.out, {{"photos", std::to_string(rows)},
                                {"with a position", std::to_string(placed.size())},
                                {"geotagged", std::to_string(written)}});
  }
  if (written == 0) {
    context.err << fmt::format("no photo has a position with a 1-σ error up to {} m: nothing was written\n",
                               max_sigma_m_);
    return kRefused;
  }
  write_file_atomic(staging.path() / "positions.csv", std::string_view(table));
  staging.commit();
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_flight_geotag() { return std::make_unique<FlightGeotagCommand>(); }

}  // namespace nadir
