# Read by ctest: makes each suite of a GoogleTest program a test of ctest, named folder.Suite. A process for each suite and
# not for each case: cases share what their suite makes once (SetUpTestSuite), and a start costs as much as most cases.
# Set by the caller: SUITES_NAME, SUITES_PROGRAM, SUITES_EMULATOR (what runs it; empty: the machine), SUITES_LIST (where the
# list is kept until the program or the caller changes), SUITES_CALLER (the file that includes this one), SUITES_COST (ctest
# begins with those of the highest; empty: none).
if(NOT EXISTS "${SUITES_PROGRAM}")
  add_test("${SUITES_NAME}.NOT_BUILT" "${SUITES_NAME}.NOT_BUILT")
  return()
endif()

if(NOT EXISTS "${SUITES_LIST}" OR "${SUITES_PROGRAM}" IS_NEWER_THAN "${SUITES_LIST}"
    OR "${CMAKE_CURRENT_LIST_FILE}" IS_NEWER_THAN "${SUITES_LIST}" OR "${SUITES_CALLER}" IS_NEWER_THAN "${SUITES_LIST}")
  execute_process(COMMAND ${SUITES_EMULATOR} "${SUITES_PROGRAM}" --gtest_list_tests TIMEOUT 60
    OUTPUT_VARIABLE listing ERROR_VARIABLE complaint RESULT_VARIABLE result)
  if(NOT result EQUAL 0)
    message(FATAL_ERROR "${SUITES_PROGRAM} does not list its tests (${result}): ${complaint}")
  endif()
  # "Suite.", perhaps with "  # TypeParam = …", and under it its cases, indented.
  string(REGEX MATCHALL "(^|\n)[A-Za-z0-9_/]+\\." suites "${listing}")
  set(tests "")
  set(command "")
  foreach(word IN LISTS SUITES_EMULATOR SUITES_PROGRAM)
    string(APPEND command " [[${word}]]")
  endforeach()
  foreach(suite IN LISTS suites)
    string(REGEX REPLACE "[\n.]" "" suite "${suite}")
    string(APPEND tests "add_test([[${SUITES_NAME}.${suite}]]${command} [[--gtest_filter=${suite}.*]])\n")
    string(APPEND tests "set_tests_properties([[${SUITES_NAME}.${suite}]] PROPERTIES LABELS ${SUITES_NAME} TIMEOUT 900 SKIP_RETURN_CODE 77)\n")
    if(SUITES_COST)
      string(APPEND tests "set_tests_properties([[${SUITES_NAME}.${suite}]] PROPERTIES COST ${SUITES_COST})\n")
    endif()
  endforeach()
  file(WRITE "${SUITES_LIST}" "${tests}")
endif()
include("${SUITES_LIST}")
