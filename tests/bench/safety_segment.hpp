// A flight through the localizer, and its results compared with the truth.
#pragma once

#include <functional>
#include <memory>

#include "safety_flight.hpp"
#include "safety_record.hpp"

namespace nadir::bench {

class Segments {
 public:
  // Makes the worlds, which takes some seconds each: those of the base seed.
  Segments(int worlds, std::uint64_t base_seed, FrameSpacing spacing, MapMatcherFactory matcher);

  // The same record for the same seeds, whatever was run before; may be called by several threads. talk: given a line
  // for every frame.
  Record run(std::uint64_t base_seed, std::uint64_t index, const std::function<void(const std::string&)>& talk) const;

 private:
  const TileSource& tiles_of(const Flight& flight) const;

  Photographer photographer_;
  Worlds worlds_;
  FrameSpacing spacing_;
  MapMatcherFactory matcher_;
};

}  // namespace nadir::bench
