// Writes airframe.json and its signature, as a folder that appears complete or not at all.
//
// airframe.json.sig is a DSSE envelope with a detached payload (trust/signatures.hpp), as a package's
// manifest.sig.
#pragma once

#include <filesystem>
#include <string>

#include "trust/keys.hpp"
#include "vision/camera.hpp"

namespace nadir {

// The document that read_airframe() reads.
std::string airframe_json(const Airframe& airframe);

// Throws UsageError when the folder exists, or the reader would reject the airframe.
void write_airframe(const std::filesystem::path& folder, const Airframe& airframe, const PrivateKey& key);

}  // namespace nadir
