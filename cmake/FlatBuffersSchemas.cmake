# nadir_flatbuffers(<target> NAMES <name>…)
# Makes <name>_generated.h, and <name>_bfbs_generated.h with the binary schema, of schemas/recorder/<name>.fbs. Both are
# included as "fbs/<name>_generated.h", in .cpp files only.
find_program(FLATC flatc REQUIRED)
find_path(FLATBUFFERS_INCLUDE_DIR flatbuffers/flatbuffers.h REQUIRED)

function(nadir_flatbuffers target)
  cmake_parse_arguments(FBS "" "" "NAMES" ${ARGN})
  set(folder "${CMAKE_CURRENT_BINARY_DIR}/generated/fbs")
  file(GLOB schemas CONFIGURE_DEPENDS "${PROJECT_SOURCE_DIR}/schemas/recorder/*.fbs")
  set(headers "")
  foreach(name IN LISTS FBS_NAMES)
    set(made "${folder}/${name}_generated.h" "${folder}/${name}_bfbs_generated.h")
    add_custom_command(
      OUTPUT ${made}
      COMMAND "${FLATC}" --cpp --cpp-std c++17 --scoped-enums -b --schema --bfbs-comments --bfbs-gen-embed -o "${folder}"
              "${PROJECT_SOURCE_DIR}/schemas/recorder/${name}.fbs"
      DEPENDS ${schemas}
      COMMENT "flatc ${name}.fbs"
      VERBATIM)
    list(APPEND headers ${made})
  endforeach()
  target_sources(${target} PRIVATE ${headers})
  target_include_directories(${target} SYSTEM PRIVATE "${CMAKE_CURRENT_BINARY_DIR}/generated" "${FLATBUFFERS_INCLUDE_DIR}")
endfunction()
