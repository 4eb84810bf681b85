# CPack's Debian packages. Dependencies are those that dpkg-shlibdeps finds; the bytes depend on the sources and on
# SOURCE_DATE_EPOCH alone (./run package sets it).
set(CPACK_GENERATOR DEB)
set(CPACK_VERBATIM_VARIABLES ON)
set(CPACK_PACKAGE_VERSION "${PROJECT_VERSION}")
set(CPACK_PACKAGE_CONTACT "${NADIR_MAINTAINER}")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "")
set(CPACK_PACKAGING_INSTALL_PREFIX "/usr")
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
    OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
if(CMAKE_CROSSCOMPILING)
  set(CPACK_DEBIAN_PACKAGE_ARCHITECTURE "${NADIR_DEBIAN_ARCHITECTURE}")
  set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS
      "${CMAKE_SYSROOT}/lib/${CMAKE_LIBRARY_ARCHITECTURE}" "${CMAKE_SYSROOT}/usr/lib/${CMAKE_LIBRARY_ARCHITECTURE}")
endif()

# nadir_package(<component> SECTION … DESCRIPTION … [DEPENDS …] [RECOMMENDS …] [SUGGESTS …] [SCRIPTS <file>…] [ALL])
# DESCRIPTION: the synopsis, and lines below it; no semicolons.
set(CPACK_COMPONENTS_ALL "")
macro(nadir_package component)
  cmake_parse_arguments(PACKAGE "ALL" "SECTION;DESCRIPTION;DEPENDS;RECOMMENDS;SUGGESTS" "SCRIPTS" ${ARGN})
  list(APPEND CPACK_COMPONENTS_ALL ${component})
  string(TOUPPER "${component}" upper)
  set(CPACK_DEBIAN_${upper}_PACKAGE_NAME "${component}")
  set(CPACK_DEBIAN_${upper}_PACKAGE_SECTION "${PACKAGE_SECTION}")
  set(CPACK_DEBIAN_${upper}_DESCRIPTION "${PACKAGE_DESCRIPTION}")
  foreach(field IN ITEMS DEPENDS RECOMMENDS SUGGESTS)
    if(PACKAGE_${field})
      set(CPACK_DEBIAN_${upper}_PACKAGE_${field} "${PACKAGE_${field}}")
    endif()
  endforeach()
  if(PACKAGE_ALL)
    set(CPACK_DEBIAN_${upper}_PACKAGE_ARCHITECTURE all)
    set(CPACK_DEBIAN_${upper}_PACKAGE_SHLIBDEPS OFF)
  endif()
  if(PACKAGE_SCRIPTS)
    list(TRANSFORM PACKAGE_SCRIPTS PREPEND "${CMAKE_CURRENT_LIST_DIR}/debian/${component}/")
    set(CPACK_DEBIAN_${upper}_PACKAGE_CONTROL_EXTRA "${PACKAGE_SCRIPTS}")
  endif()
endmacro()

nadir_package(nadir SECTION science RECOMMENDS "nadir-doc" SUGGESTS "nadird, ffmpeg"
  DESCRIPTION "offline map packages for GPS-denied flight, and replay against them
Builds, signs and checks the map packages by which an unmanned aircraft
finds its position with a camera when GPS is jammed or spoofed, replays
recorded flights and photos against them, and serves a desk with a web page.
This is the program of planners and analysts. The aircraft runs nadird.")

nadir_package(nadird SECTION science DEPENDS "adduser" SUGGESTS "nadird-camera-gstreamer, nadird-camera-video, nadir-doc"
  SCRIPTS conffiles postinst prerm postrm
  DESCRIPTION "position for a fixed-wing UAV when GPS is denied
Runs beside the autopilot: matches what a camera sees with a signed map
package, sends positions with their accuracy over MAVLink, and detects
jammed and spoofed GPS. Nothing is fetched in flight.
The service is not started before it is configured in /etc/nadir.")

if(TARGET nadir_camera_video)
  nadir_package(nadird-camera-video SECTION science DEPENDS "nadird (= ${PROJECT_VERSION}-1)"
    DESCRIPTION "position for a fixed-wing UAV when GPS is denied (video cameras)
The plug-in with which nadird reads V4L2 and RTSP cameras and recordings,
through OpenCV. Without it nadird reads pictures that another program
writes to a folder.")
endif()

if(TARGET nadir_camera_gstreamer)
  nadir_package(nadird-camera-gstreamer SECTION science DEPENDS "nadird (= ${PROJECT_VERSION}-1), gstreamer1.0-plugins-base"
    DESCRIPTION "position for a fixed-wing UAV when GPS is denied (GStreamer cameras)
The plug-in with which nadird reads any camera that GStreamer reads, with
the times at which its driver stamped the frames.")
endif()

if(TARGET nadir_network_onnxruntime)
  nadir_package(nadir-network-onnxruntime SECTION science DEPENDS "nadird (= ${PROJECT_VERSION}-1) | nadir (= ${PROJECT_VERSION}-1)" SUGGESTS "libonnxruntime1.21"
    DESCRIPTION "position for a fixed-wing UAV when GPS is denied (second matcher)
The plug-in with which nadird and nadir run the network of a second
matcher. It loads libonnxruntime.so.1, which Debian 12 does not have, and
the model that the airframe file names, which is no part of it.")
endif()

nadir_package(nadir-candidates SECTION science DEPENDS "adduser" SUGGESTS "nadir-doc"
  SCRIPTS conffiles postinst prerm postrm
  DESCRIPTION "service that promotes map tiles on which flights agree
Takes tiles that aircraft made in flight, checks them, and promotes those
on which independent flights agree, as imagery for the next map package.
The service is not started before it is configured in /etc/nadir-candidates.")

nadir_package(nadir-doc SECTION doc ALL
  DESCRIPTION "documentation of nadir and nadird
Method, safety case, commands, file formats and benchmarks of Nadir, which
tells a fixed-wing UAV where it is when GPS is denied, with example missions
and the schemas of its files.")

include(CPack)
