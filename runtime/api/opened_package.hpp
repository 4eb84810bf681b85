// What the API shows and uses of a package that the service has opened, or of one that it has rejected.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "api/api.hpp"
#include "package/open_package.hpp"

namespace nadir {

PackageView package_view(const OpenPackage& package);
PackageView refused_package(const Findings& findings);  // the first refusal is the reason

// Tiles by a reader of their own, with the digests that were signed: pages never delay the flight's reads.
// folder: of the package.
ApiPackage package_for_api(std::shared_ptr<const OpenPackage> package);

}  // namespace nadir
