# Debian ships OpenCVConfig.cmake only in libopencv-dev, which drags in VTK and Qt. The module packages are
# enough for us, so each module becomes an imported target opencv::<module> of its own.
function(nadir_find_opencv)
  find_path(NADIR_OPENCV_INCLUDE_DIR opencv2/core.hpp PATH_SUFFIXES opencv4 REQUIRED)
  foreach(module IN LISTS ARGN)
    find_library(NADIR_OPENCV_${module} opencv_${module} REQUIRED)
    add_library(opencv::${module} UNKNOWN IMPORTED GLOBAL)
    set_target_properties(opencv::${module} PROPERTIES
      IMPORTED_LOCATION "${NADIR_OPENCV_${module}}"
      INTERFACE_SYSTEM_INCLUDE_DIRECTORIES "${NADIR_OPENCV_INCLUDE_DIR}"
      INTERFACE_INCLUDE_DIRECTORIES "${NADIR_OPENCV_INCLUDE_DIR}")
  endforeach()
endfunction()
