# One function per kind of target, so that the folders' own lists stay a few lines.

# nadir_layer(<name> SOURCES … [PUBLIC …] [PRIVATE …] [PCH …])
# The static library nadir_<name> of libgeo/<name>; other folders link it as nadir::<name>.
function(nadir_layer name)
  cmake_parse_arguments(LAYER "" "" "SOURCES;PUBLIC;PRIVATE;PCH" ${ARGN})
  add_library(nadir_${name} STATIC ${LAYER_SOURCES})
  add_library(nadir::${name} ALIAS nadir_${name})
  target_include_directories(nadir_${name} PUBLIC "${PROJECT_SOURCE_DIR}/libgeo")
  target_link_libraries(nadir_${name} PUBLIC ${LAYER_PUBLIC} PRIVATE ${LAYER_PRIVATE} $<BUILD_INTERFACE:nadir_warnings>)
  if(LAYER_PCH)
    target_precompile_headers(nadir_${name} PRIVATE ${LAYER_PCH})
  endif()
endfunction()

# nadir_test(<name> SOURCES … LINK …): one GoogleTest program per folder of tests/, its cases known to ctest by name.
function(nadir_test name)
  cmake_parse_arguments(TEST "" "" "SOURCES;LINK" ${ARGN})
  add_executable(test_${name} ${TEST_SOURCES})
  target_link_libraries(test_${name} PRIVATE ${TEST_LINK} nadir_test_support GTest::gmock GTest::gtest_main nadir_warnings)
  target_include_directories(test_${name} PRIVATE "${PROJECT_SOURCE_DIR}/tests")
  target_precompile_headers(test_${name} REUSE_FROM nadir_test_pch)
  gtest_discover_tests(test_${name} TEST_PREFIX "${name}." DISCOVERY_MODE PRE_TEST
    PROPERTIES LABELS ${name} TIMEOUT 300)
endfunction()
