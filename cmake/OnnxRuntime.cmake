# NADIR_ONNXRUNTIME_INCLUDE_DIR: the folder of onnxruntime_c_api.h, of a package on this machine or fetched once into
# build-onnxruntime/ (.ci/onnxruntime.sh). Not found: the network plug-in is not built, and nothing else changes. The library
# itself is never linked.
find_path(NADIR_ONNXRUNTIME_INCLUDE_DIR onnxruntime_c_api.h PATH_SUFFIXES onnxruntime NO_CMAKE_FIND_ROOT_PATH)
if(NOT NADIR_ONNXRUNTIME_INCLUDE_DIR)
  set(fetched "${PROJECT_SOURCE_DIR}/build-onnxruntime")
  execute_process(COMMAND "${PROJECT_SOURCE_DIR}/.ci/onnxruntime.sh" "${fetched}" RESULT_VARIABLE failed)
  if(failed)
    message(WARNING "No header of ONNX Runtime: nadir_network_onnxruntime.so is not built")
  else()
    find_path(NADIR_ONNXRUNTIME_INCLUDE_DIR onnxruntime_c_api.h
      PATHS "${fetched}/usr/include/onnxruntime" NO_DEFAULT_PATH NO_CMAKE_FIND_ROOT_PATH)
  endif()
endif()

# The tests run networks by the wheel's library, which lies where the plug-in looks.
file(GLOB wheel "${NADIR_VENV}/lib/python3*/site-packages/onnxruntime/capi/libonnxruntime.so.1.*")
if(wheel AND NOT CMAKE_CROSSCOMPILING)
  file(MAKE_DIRECTORY "${CMAKE_RUNTIME_OUTPUT_DIRECTORY}")
  file(CREATE_LINK "${wheel}" "${CMAKE_RUNTIME_OUTPUT_DIRECTORY}/libonnxruntime.so.1" SYMBOLIC)
endif()
