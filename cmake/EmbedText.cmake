# nadir_embed_text(<target> OUTPUT <file.cpp> INCLUDE <header> NAMESPACE <ns> [<variable> <file>…]…)
# Makes the texts of files constants of the program. NAME=FILE[+FILE…]: the files are joined in order. The header that
# declares the constants is written by hand.
function(nadir_embed_text target)
  cmake_parse_arguments(EMBED "" "OUTPUT;INCLUDE;NAMESPACE" "TEXTS" ${ARGN})
  set(inputs "")
  foreach(text IN LISTS EMBED_TEXTS)
    string(REGEX REPLACE "^[^=]*=" "" files "${text}")
    string(REPLACE "+" ";" files "${files}")
    foreach(file IN LISTS files)
      cmake_path(ABSOLUTE_PATH file BASE_DIRECTORY "${CMAKE_CURRENT_SOURCE_DIR}")
      list(APPEND inputs "${file}")
    endforeach()
  endforeach()
  list(JOIN EMBED_TEXTS "," texts)
  add_custom_command(
    OUTPUT "${EMBED_OUTPUT}"
    COMMAND "${CMAKE_COMMAND}" "-DOUTPUT=${EMBED_OUTPUT}" "-DINCLUDE=${EMBED_INCLUDE}" "-DNAMESPACE=${EMBED_NAMESPACE}"
            "-DTEXTS=${texts}" "-DFOLDER=${CMAKE_CURRENT_SOURCE_DIR}" -P "${PROJECT_SOURCE_DIR}/cmake/WriteEmbeddedText.cmake"
    DEPENDS ${inputs} "${PROJECT_SOURCE_DIR}/cmake/WriteEmbeddedText.cmake"
    COMMENT "Embedding ${EMBED_INCLUDE}'s texts"
    VERBATIM)
  target_sources(${target} PRIVATE "${EMBED_OUTPUT}")
endfunction()
