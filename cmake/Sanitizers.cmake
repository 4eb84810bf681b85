# NADIR_SANITIZE=address,undefined or thread; the presets asan and tsan set it.
set(NADIR_SANITIZE "" CACHE STRING "Sanitizers for everything that is built here, comma separated")
if(NADIR_SANITIZE)
  # -O1 -g1: quicker to compile than -O2 -g, and reports still name the line.
  add_compile_options(-O1 -g1 -fsanitize=${NADIR_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  add_link_options(-fsanitize=${NADIR_SANITIZE})
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    # What the sanitizers put in leads gcc's flow analysis astray: copies of empty ranges. The plain build has the warning.
    add_compile_options(-Wno-stringop-overread)
    if(NADIR_SANITIZE MATCHES thread)
      add_compile_options(-Wno-tsan)  # gcc warns that it cannot follow fences; Asio has some
    endif()
  endif()
endif()

# libFuzzer programs of the readers (tests/fuzz), with clang alone: coverage and sanitizers for everything.
option(NADIR_FUZZ "Build the libFuzzer programs" OFF)
if(NADIR_FUZZ)
  if(NOT CMAKE_CXX_COMPILER_ID STREQUAL "Clang")
    message(FATAL_ERROR "NADIR_FUZZ needs clang: -DCMAKE_C_COMPILER=clang-19 -DCMAKE_CXX_COMPILER=clang++-19")
  endif()
  add_compile_options(-fsanitize=fuzzer-no-link,address,undefined -fno-omit-frame-pointer -fno-sanitize-recover=all)
  add_link_options(-fsanitize=address,undefined)
endif()
