# NADIR_PYTHON: the interpreter with the packages of .ci/python-requirements.txt. One environment serves every build
# folder of a checkout.
set(NADIR_VENV "${PROJECT_SOURCE_DIR}/build-venv" CACHE PATH "Python environment, made when it is missing")
execute_process(COMMAND "${PROJECT_SOURCE_DIR}/.ci/python.sh" "${NADIR_VENV}" RESULT_VARIABLE failed)
if(failed)
  message(FATAL_ERROR "No Python environment in ${NADIR_VENV}: its messages stand above")
endif()
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS "${PROJECT_SOURCE_DIR}/.ci/python-requirements.txt")
set(NADIR_PYTHON "${NADIR_VENV}/bin/python")
