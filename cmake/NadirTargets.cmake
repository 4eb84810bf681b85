# One function per kind of target, so that the folders' own lists stay a few lines.

# nadir_library(<name> [COMPUTES] [PUBLIC …] [PRIVATE …] [PCH …])
# The static library nadir_<name> of every source in the calling folder; other folders link it as nadir::<name>. Includes
# name the folder: libgeo/base/error.hpp is "base/error.hpp". COMPUTES: pixels, matrices or many tiles, hence optimised fully.
function(nadir_library name)
  cmake_parse_arguments(LIBRARY "COMPUTES" "" "PUBLIC;PRIVATE;PCH" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS "${CMAKE_CURRENT_SOURCE_DIR}/*.cpp")
  get_filename_component(above "${CMAKE_CURRENT_SOURCE_DIR}" DIRECTORY)
  add_library(nadir_${name} STATIC ${sources})
  add_library(nadir::${name} ALIAS nadir_${name})
  target_include_directories(nadir_${name} PUBLIC "${above}")
  target_link_libraries(nadir_${name} PUBLIC ${LIBRARY_PUBLIC} PRIVATE ${LIBRARY_PRIVATE} $<BUILD_INTERFACE:nadir_warnings>)
  if(LIBRARY_COMPUTES)
    target_compile_options(nadir_${name} PRIVATE ${NADIR_COMPUTES})
  endif()
  if(LIBRARY_PCH)
    target_precompile_headers(nadir_${name} PRIVATE ${LIBRARY_PCH})
  endif()
endfunction()

# nadir_test(<name> [SOURCES …] LINK …): one GoogleTest program per folder of tests/, of its *_test.cpp and SOURCES; its
# suites are known to ctest as <name>.<Suite>.
function(nadir_test name)
  cmake_parse_arguments(TEST "" "" "SOURCES;LINK" ${ARGN})
  file(GLOB cases CONFIGURE_DEPENDS "${CMAKE_CURRENT_SOURCE_DIR}/*_test.cpp")
  add_executable(test_${name} ${cases} ${TEST_SOURCES})
  target_link_libraries(test_${name} PRIVATE ${TEST_LINK} nadir_test_support nadir_test_main nadir_warnings)
  target_include_directories(test_${name} PRIVATE "${PROJECT_SOURCE_DIR}/tests")
  target_precompile_headers(test_${name} REUSE_FROM nadir_test_pch)
  set(suites "${CMAKE_CURRENT_BINARY_DIR}/${name}_suites")
  file(GENERATE OUTPUT "${suites}.cmake" CONTENT "set(SUITES_NAME ${name})
set(SUITES_PROGRAM [[$<TARGET_FILE:test_${name}>]])
set(SUITES_EMULATOR [[${CMAKE_CROSSCOMPILING_EMULATOR}]])
set(SUITES_LIST [[${suites}_list.cmake]])
include([[${PROJECT_SOURCE_DIR}/cmake/DiscoverSuites.cmake]])
")
  set_property(DIRECTORY APPEND PROPERTY TEST_INCLUDE_FILES "${suites}.cmake")
endfunction()
