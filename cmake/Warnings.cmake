# Our own code compiles without a warning; the headers of others are included as SYSTEM.
add_library(nadir_warnings INTERFACE)
target_compile_options(nadir_warnings INTERFACE
  -Wall -Wextra -Wpedantic -Werror
  -Wshadow -Wconversion -Wsign-conversion -Wdouble-promotion
  -Wold-style-cast -Wcast-align -Wnon-virtual-dtor -Woverloaded-virtual
  -Wnull-dereference -Wformat=2 -Wimplicit-fallthrough)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  target_compile_options(nadir_warnings INTERFACE -Wduplicated-cond -Wlogical-op)
  # gcc 12 sees overlapping copies in `"text" + std::string` (its bug 105329).
  target_compile_options(nadir_warnings INTERFACE -Wno-restrict)
  # Sources that are compiled together are no main files: a type of an anonymous namespace within another is no fault.
  target_compile_options(nadir_warnings INTERFACE -Wno-subobject-linkage)
  # gcc 12 says on arm64 that gcc 9 passed some arguments in another way.
  target_compile_options(nadir_warnings INTERFACE $<$<STREQUAL:${CMAKE_SYSTEM_PROCESSOR},aarch64>:-Wno-psabi>)
  # gcc 12 reports null dereferences and uninitialised members inside the inlined standard library and Eigen.
  target_compile_options(nadir_warnings INTERFACE -Wno-null-dereference -Wno-maybe-uninitialized -Wno-array-bounds -Wno-stringop-overflow)
endif()
if(CMAKE_CXX_COMPILER_ID STREQUAL "Clang")
  # clang only fuzzes here; it warns of other things than gcc, in the standard library's headers as well.
  target_compile_options(nadir_warnings INTERFACE -Wno-error)
endif()
