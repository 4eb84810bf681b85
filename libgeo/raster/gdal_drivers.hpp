// Which of GDAL's drivers may open a file. GDAL decides by a file's content, not by its name: a "map.tif" may be the
// description of a map service, and a VRT may name any other data source. So the drivers that may open anything are a
// short list of formats that are files on this machine; the others can still write (docs/commands/cache-build.md).
#pragma once

#include <filesystem>
#include <string>

class GDALDriver;

namespace nadir {

// Registers GDAL's drivers, lets only those of the list open data sources, and closes GDAL's file systems that reach
// the network (pinned_files.hpp has the one that may). Once in a process; call it before any other use of GDAL.
void register_gdal_drivers();

// The list, for messages: "GeoTIFF, JPEG 2000, …".
std::string readable_raster_formats();
std::string readable_vector_formats();

// The driver that writes vectors in this format. Throws Error where this GDAL has none: "Parquet" needs Apache Arrow.
GDALDriver& vector_writer(const std::string& driver, const std::filesystem::path& out);

// Throws UsageError when the raster is remote, or when a VRT or an .aux.xml file that belongs to it names something
// that is no file on this machine (a URL, a path of GDAL's virtual file systems), however deeply. Nothing is opened by
// GDAL.
void refuse_remote_raster(const std::filesystem::path& path);

// Throws the UsageError that this raster is remote. found: what it is, or names.
[[noreturn]] void reject_remote(const std::filesystem::path& raster, const std::string& found);

}  // namespace nadir
