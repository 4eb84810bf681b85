# nadir_mavlink_headers(<target> <dialect>)
# The interface library <target> with MAVLink's C headers, <dialect/mavlink.h>: the official definitions through the
# official generator, both of which pymavlink carries. Generated at build time; include them in sources alone.
function(nadir_mavlink_headers target dialect)
  execute_process(
    COMMAND "${NADIR_PYTHON}" -c "import pathlib, pymavlink; print(pathlib.Path(pymavlink.__file__).parent, end='')"
    OUTPUT_VARIABLE pymavlink COMMAND_ERROR_IS_FATAL ANY)
  set(definition "${pymavlink}/dialects/v20/${dialect}.xml")
  set(folder "${CMAKE_CURRENT_BINARY_DIR}/generated")
  add_custom_command(
    OUTPUT "${folder}/${dialect}/mavlink.h"
    COMMAND "${CMAKE_COMMAND}" -E rm -rf "${folder}"
    COMMAND "${NADIR_PYTHON}" -m pymavlink.tools.mavgen --lang=C --wire-protocol=2.0 "--output=${folder}"
            "${definition}" > "${CMAKE_CURRENT_BINARY_DIR}/mavgen.log"
    DEPENDS "${definition}" "${NADIR_VENV}/made-from"
    COMMENT "Generating the MAVLink headers of ${dialect}"
    VERBATIM)
  add_custom_target(${target}_generated DEPENDS "${folder}/${dialect}/mavlink.h")
  add_library(${target} INTERFACE)
  add_dependencies(${target} ${target}_generated)
  target_include_directories(${target} SYSTEM INTERFACE "${folder}")
endfunction()
