#include "commands/cache/imagery_options.hpp"

#include <algorithm>
#include <thread>

#include "cli/options.hpp"

namespace nadir {

void ImageryOptions::setup(Options& options) {
  options.value("--mosaic", mosaic_, "ORDER", "which raster lies on top: the first, the newest, the finest")
      .one_of({"priority", "newest", "finest"});
  options.value("--seam", seam_, "KIND", "how a raster ends where another continues").one_of({"hard", "feather"});
  options.value("--feather-m", feather_m_, "METRES", "over how much a feathered seam fades").between(0.1, 1000);
  options.value("--threads", threads_, "N", "threads; all processors when not given").between(1, 256);
  options.value("--captured", captured_, "TIME", "when the imagery was taken, instead of the STAC Item's datetime");
  options.value("--gsd", gsd_m_, "METRES", "ground sample distance, instead of the item's").between(1e-4, 1e4);
  options.value("--ce90", ce90_m_, "METRES", "90 % circular error, instead of the item's").between(1e-4, 1e5);
  options.value("--provider", provider_, "NAME", "who made the imagery, instead of the item's");
}

MosaicOptions ImageryOptions::mosaic() const {
  const MosaicOrder order = mosaic_ == "newest"   ? MosaicOrder::newest
                            : mosaic_ == "finest" ? MosaicOrder::finest
                                                  : MosaicOrder::priority;
  return {order, seam_ == "feather" ? feather_m_ : 0};
}

int ImageryOptions::threads() const {
  return threads_.value_or(static_cast<int>(std::max(1U, std::thread::hardware_concurrency())));
}

}  // namespace nadir
