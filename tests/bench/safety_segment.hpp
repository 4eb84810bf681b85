// A flight through the localizer, and what it said held against the truth.
#pragma once

#include <functional>
#include <memory>

#include "safety_flight.hpp"
#include "safety_record.hpp"

namespace nadir::bench {

class Segments {
 public:
  // Makes the worlds, which takes some seconds each.
  explicit Segments(int worlds);

  // The same record for the same seeds, whatever was run before; may be called by several threads. talk: told a line
  // for every frame.
  Record run(std::uint64_t base_seed, std::uint64_t index, const std::function<void(const std::string&)>& talk) const;

  const std::vector<std::unique_ptr<World>>& worlds() const { return worlds_; }
  const Photographer& photographer() const { return photographer_; }

 private:
  const TileSource& tiles_of(const Flight& flight) const;

  Photographer photographer_;
  std::vector<std::unique_ptr<World>> worlds_;
  std::vector<cv::Mat> old_pictures_;
  std::vector<std::unique_ptr<PictureTiles>> old_maps_;
};

}  // namespace nadir::bench
