// Pinned objects as files that GDAL reads: the file system /vsipinned/, through which nothing but what was mounted can
// be opened. Every byte that GDAL gets has been compared with the pin (object_storage/pinned_object.hpp).
//
// GDAL's own network file systems stay closed (gdal_drivers.hpp). What is taken of them are their credentials: requests
// are signed as /vsis3/, /vsigs/ and /vsiaz/ would, with what GDAL finds in the environment, in ~/.aws/credentials and
// ~/.aws/config, or as the role of a machine in a cloud (gdal.org, "GDAL Virtual File Systems").
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "object_storage/pinned_object.hpp"

namespace nadir {

// One for the process: signs as GDAL does.
std::shared_ptr<ObjectClient> object_client();

// From now on the object's URL is the path of a raster. Throws UsageError when it is mounted with another digest.
void mount_object(const ObjectPin& pin);

// The object that the path names; null for files on this machine, and for objects that are not mounted.
PinnedObject* mounted_object(const std::filesystem::path& path);

// The path as GDAL opens it: a mounted object's beneath /vsipinned/, any other as it is.
std::string gdal_name(const std::filesystem::path& path);

}  // namespace nadir
