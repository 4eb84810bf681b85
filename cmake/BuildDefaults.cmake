# Language level, build type, output folders and the compiler cache.
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)

if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
  set(CMAKE_BUILD_TYPE Release CACHE STRING "Release, Debug or RelWithDebInfo" FORCE)
endif()

# Release keeps assertions out but line tables in: a crash on an aircraft must be readable. Most of the code waits for files,
# sockets and libraries: -O1 compiles it in two thirds of the time. What computes says so (`COMPUTES`, NadirTargets.cmake).
set(CMAKE_CXX_FLAGS_RELEASE "-O1 -g1 -DNDEBUG")
set(NADIR_COMPUTES $<$<CONFIG:Release>:-O3>)

# By default gcc looks for memory that it can free whenever its heap has doubled: a tenth of its time for units as large as ours.
# The first 700 MB are not looked through here, and then what has grown fourfold: a unit takes up to 2.2 GB instead of 1.8.
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  add_compile_options("SHELL:--param ggc-min-heapsize=700000" "SHELL:--param ggc-min-expand=300")
endif()

# Results must not depend on whether the compiler contracts a*b+c.
add_compile_options(-ffp-contract=off)
if(CMAKE_SYSTEM_PROCESSOR STREQUAL "aarch64")
  include_directories(BEFORE SYSTEM "${PROJECT_SOURCE_DIR}/cmake/arm64/include")  # nor Eigen's packets
  add_compile_definitions(EIGEN_MATRIXBASE_PLUGIN=<eigen_groups_as_on_amd64.hpp>)
endif()

# Names of files, in line tables and messages, count from the checkout: two folders give the same bytes. In gdb: `directory`
# with the checkout. A build folder inside of it is named by the second map, because the last one that fits counts.
add_compile_options("-ffile-prefix-map=${PROJECT_SOURCE_DIR}=." "-ffile-prefix-map=${PROJECT_BINARY_DIR}=./build")

# Compiled by itself, a source costs mostly the reading of headers and the templates in them (docs/building.md): the sources of
# a folder are compiled up to 32 at a time. So names in anonymous namespaces are unique in their folder. OFF compiles each source by itself:
# for clang-tidy, and now and then to see that each includes what it uses.
option(NADIR_UNITY "Compile the sources of a folder together" ON)
set(CMAKE_UNITY_BUILD ${NADIR_UNITY})
set(CMAKE_UNITY_BUILD_BATCH_SIZE 32)

set(CMAKE_RUNTIME_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}/bin")
set(CMAKE_ARCHIVE_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}/lib")
set(CMAKE_LIBRARY_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}/lib")

find_program(CCACHE_PROGRAM ccache)
if(CCACHE_PROGRAM)
  set(CMAKE_CXX_COMPILER_LAUNCHER
      "${CMAKE_COMMAND}" -E env
      CCACHE_SLOPPINESS=pch_defines,time_macros,include_file_mtime,include_file_ctime
      "${CCACHE_PROGRAM}")
endif()
