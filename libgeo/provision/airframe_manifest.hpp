// airframe.json and its signature, as a folder that appears whole or not at all.
//
// airframe.json.sig is a DSSE envelope with a detached payload (trust/airframe_signature.hpp), as a package's
// manifest.sig.
#pragma once

#include <filesystem>
#include <string>

#include "trust/keys.hpp"
#include "vision/camera.hpp"

namespace nadir {

// The document that read_airframe() reads.
std::string airframe_json(const Airframe& airframe);

// Throws UsageError when the folder is there, or the reader would refuse the airframe.
void write_airframe(const std::filesystem::path& folder, const Airframe& airframe, const PrivateKey& key);

}  // namespace nadir
