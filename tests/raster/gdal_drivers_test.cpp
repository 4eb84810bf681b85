// Files that are no rasters but say where to fetch some: whatever they are called, nothing is fetched.
#include "raster/gdal_drivers.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <string>
#include <vector>

#include "base/error.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/test_raster.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

// A port on the loopback address that knows whether somebody came.
class Listener {
 public:
  Listener() : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    EXPECT_EQ(::bind(socket_, reinterpret_cast<sockaddr*>(&address), size), 0);
    EXPECT_EQ(::listen(socket_, 8), 0);
    EXPECT_EQ(::getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &size), 0);
    port_ = ntohs(address.sin_port);
  }
  ~Listener() { ::close(socket_); }
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  std::string url() const { return "http://127.0.0.1:" + std::to_string(port_); }
  bool visited() const {
    pollfd wait{socket_, POLLIN, 0};
    return ::poll(&wait, 1, 0) != 0;
  }

 private:
  int socket_;
  int port_ = 0;
};

class GdalDrivers : public ::testing::Test {
 protected:
  void expect_refused(const std::filesystem::path& file) {
    EXPECT_THROW(open_gdal_raster(file), Error) << file;
    EXPECT_FALSE(listener_.visited()) << file << " reached the network";
  }
  // GDAL opens the sources of a VRT when pixels are asked for.
  void expect_no_pixels(const std::filesystem::path& file) {
    EXPECT_THROW(
        {
          const GdalDataset set(file);
          set.read({0, 0, 16, 16}, {16, 16});
        },
        Error)
        << file;
    EXPECT_FALSE(listener_.visited()) << file << " reached the network";
  }
  static std::string vrt(const std::string& source) {
    return "<VRTDataset rasterXSize=\"16\" rasterYSize=\"16\"><VRTRasterBand dataType=\"Byte\" band=\"1\">"
           "<SimpleSource><SourceFilename relativeToVRT=\"0\">" +
           source + "</SourceFilename><SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>";
  }
  test::TemporaryFolder folder_;
  Listener listener_;
};

TEST_F(GdalDrivers, DescriptionsOfServicesAreRejected) {
  const std::string wms = "<GDAL_WMS><Service name=\"TMS\"><ServerUrl>" + listener_.url() +
                          "/${z}/${x}/${y}.png</ServerUrl></Service><DataWindow><UpperLeftX>-20037508.34</UpperLeftX>"
                          "<UpperLeftY>20037508.34</UpperLeftY><LowerRightX>20037508.34</LowerRightX>"
                          "<LowerRightY>-20037508.34</LowerRightY><TileLevel>4</TileLevel><TileCountX>1</TileCountX>"
                          "<TileCountY>1</TileCountY></DataWindow><Projection>EPSG:3857</Projection><BlockSizeX>256"
                          "</BlockSizeX><BlockSizeY>256</BlockSizeY><BandsCount>3</BandsCount></GDAL_WMS>";
  const std::string wmts =
      "<GDAL_WMTS><GetCapabilitiesUrl>" + listener_.url() + "/wmts</GetCapabilitiesUrl></GDAL_WMTS>";
  const std::string wcs = "<WCS_GDAL><ServiceURL>" + listener_.url() +
                          "/?</ServiceURL><Version>1.0.0</Version><CoverageName>map</CoverageName></WCS_GDAL>";
  for (const char* name : {"map.tif", "map.xml", "map.vrt"}) {
    for (const std::string& text : {wms, wmts, wcs}) expect_refused(folder_.write(name, text));
  }
}

TEST_F(GdalDrivers, AVrtNamesFilesOnThisMachineOnly) {
  const std::string wmts =
      "<GDAL_WMTS><GetCapabilitiesUrl>" + listener_.url() + "/wmts</GetCapabilitiesUrl></GDAL_WMTS>";
  const std::filesystem::path service = folder_.write("innocent.tif", wmts);
  const std::string remote = listener_.url() + "/map.tif";
  folder_.write("hidden.dat", vrt("/vsicurl/" + remote));
  for (const std::string& source :
       std::vector<std::string>{"/vsicurl/" + remote, "/vsicurl_streaming/" + remote, "/vsis3/bucket/map.tif",
                                "GTIFF_DIR:1:/vsicurl/" + remote, std::string("/vsistdin/"),
                                (folder_ / "hidden.dat").string(), std::string("hidden.dat")}) {
    const std::filesystem::path file = folder_.write("map.vrt", vrt(source));
    expect_refused(file);
    std::filesystem::rename(file, folder_ / "map.tif");
    expect_refused(folder_ / "map.tif");
  }
  // A service behind a VRT is a source that does not open.
  expect_no_pixels(folder_.write("behind.vrt", vrt(service.string())));
}

TEST_F(GdalDrivers, MemoryOfTheProgramIsRejected) {
  expect_no_pixels(folder_.write("memory.vrt", vrt("MEM:::DATAPOINTER=4096,PIXELS=16,LINES=16")));
}

TEST_F(GdalDrivers, WhatMayBeReadIsNamed) {
  EXPECT_NE(readable_raster_formats().find("GeoTIFF"), std::string::npos);
  EXPECT_NE(readable_vector_formats().find("KML"), std::string::npos);
  try {
    open_gdal_raster(folder_.write("map.tif", "no raster at all"));
    ADD_FAILURE() << "opened";
  } catch (const Error& error) {
    EXPECT_NE(error.text().expected.find("GeoTIFF"), std::string::npos);
  }
}

}  // namespace
}  // namespace nadir
