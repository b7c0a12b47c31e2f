# Python's module `cloam` (python/, docs/python.md), where Python's headers, NumPy and pybind11 are installed: `cmake --install` puts it under the
# prefix as the component `python`, which the Debian package leaves out.
if(NOT Python3_EXECUTABLE AND EXISTS /usr/bin/python3)
  set(Python3_EXECUTABLE /usr/bin/python3)  # Debian's, to which its packages belong, whatever stands before it in PATH
endif()
find_package(Python3 COMPONENTS Interpreter Development.Module NumPy)
if(Python3_FOUND)  # else pybind11 would look for another
  find_package(pybind11 CONFIG)
endif()
if(Python3_FOUND AND pybind11_FOUND)
  file(GLOB python_files CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/python/*.cpp)
  pybind11_add_module(cloam-python NO_EXTRAS ${python_files})
  set_target_properties(cloam-python PROPERTIES OUTPUT_NAME cloam LIBRARY_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/lib/python
    UNITY_BUILD_BATCH_SIZE 4)
  target_include_directories(cloam-python PRIVATE ${CMAKE_SOURCE_DIR})
  target_link_libraries(cloam-python PRIVATE cloam_models cloam_flags)
  target_compile_options(cloam-python PRIVATE $<$<CONFIG:Release>:-O1>)  # it only passes on what others compute
  install(TARGETS cloam-python LIBRARY DESTINATION lib/python3/dist-packages COMPONENT python)
  add_dependencies(cli-tests cloam-python)
  set_source_files_properties(tests/cli/python_test.cpp tests/cli/python_processes_test.cpp PROPERTIES COMPILE_DEFINITIONS CLOAM_PYTHON="${Python3_EXECUTABLE}")
else()
  message(STATUS "Python's module is left out: python3-dev, python3-numpy or pybind11-dev is not installed")
endif()
