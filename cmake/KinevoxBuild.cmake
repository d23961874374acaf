# Compiler settings of all parts, and the helpers that declare a library and a test. kernels/ includes this file, too, so
# nothing here may need a package.
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
  set(CMAKE_BUILD_TYPE Release CACHE STRING "" FORCE)
endif()

find_program(CCACHE_PROGRAM ccache)
if(CCACHE_PROGRAM)
  foreach(language CXX CUDA)
    if(NOT CMAKE_${language}_COMPILER_LAUNCHER)
      set(CMAKE_${language}_COMPILER_LAUNCHER ${CCACHE_PROGRAM})
    endif()
  endforeach()
endif()

set(KINEVOX_SANITIZE "" CACHE STRING "Sanitizers for everything: address,undefined or thread")
option(KINEVOX_SANITIZE_KERNELS "Instrument the kernels, too, which take most of the time" ON)

add_library(kinevox_build_options INTERFACE)
target_compile_options(kinevox_build_options INTERFACE
  $<$<COMPILE_LANGUAGE:CXX>:-Wall -Wextra -Wpedantic -Wno-missing-field-initializers>)
if(KINEVOX_SANITIZE)
  add_compile_options($<$<COMPILE_LANGUAGE:CXX>:-fsanitize=${KINEVOX_SANITIZE}>
                      $<$<COMPILE_LANGUAGE:CXX>:-fno-omit-frame-pointer>)
  add_link_options(-fsanitize=${KINEVOX_SANITIZE})
  if(KINEVOX_SANITIZE STREQUAL "thread")
    include_directories(BEFORE ${CMAKE_CURRENT_LIST_DIR}/../tests/sanitize/headers)   # instead of the libraries' headers
  endif()
endif()

# For the rest of a folder whose code is not performance-critical: compiles in two thirds of the time.
macro(kinevox_quick_to_compile)
  if(CMAKE_BUILD_TYPE STREQUAL "Release")
    add_compile_options(-O1)
  endif()
endmacro()

# For the folders that follow: compiles six files of a target per unit, since the headers of gRPC, Eigen, OpenCV and CLI11
# take most of the time (a clean build takes half as long). Names in anonymous namespaces must differ from those in the other
# files of a unit. -DCMAKE_UNITY_BUILD=OFF compiles each file alone.
macro(kinevox_unity_builds)
  if(NOT DEFINED CMAKE_UNITY_BUILD)
    set(CMAKE_UNITY_BUILD ON)
    set(CMAKE_UNITY_BUILD_BATCH_SIZE 6)
    # A class of a single file may have members of types in an anonymous namespace.
    add_compile_options($<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>)
  endif()
endmacro()

set(KINEVOX_BUILT_FOLDER "" CACHE PATH "Build folder whose archives of KINEVOX_BUILT_LIBRARIES are linked, not compiled again")
set(KINEVOX_BUILT_LIBRARIES "" CACHE STRING "Libraries taken from KINEVOX_BUILT_FOLDER")

# kinevox_library(NAME SOURCES a.cc ... PUBLIC lib ... PRIVATE lib ...): a static library. Headers are included by their path
# from the repository's root.
get_filename_component(KINEVOX_ROOT ${CMAKE_CURRENT_LIST_DIR}/.. ABSOLUTE)
function(kinevox_library name)
  cmake_parse_arguments(ARG "" "" "SOURCES;PUBLIC;PRIVATE" ${ARGN})
  if(name IN_LIST KINEVOX_BUILT_LIBRARIES)
    file(RELATIVE_PATH folder ${KINEVOX_ROOT} ${CMAKE_CURRENT_SOURCE_DIR})
    add_library(${name}_built STATIC IMPORTED GLOBAL)
    set_target_properties(${name}_built PROPERTIES
      IMPORTED_LOCATION ${KINEVOX_BUILT_FOLDER}/${folder}/lib${name}.a)
    target_link_libraries(${name}_built INTERFACE ${ARG_PUBLIC} ${ARG_PRIVATE})
    # An ordinary target remains, without code: folders set PRIVATE properties, which an imported one cannot have.
    file(TOUCH ${CMAKE_CURRENT_BINARY_DIR}/no_code.cc)
    set(ARG_SOURCES ${CMAKE_CURRENT_BINARY_DIR}/no_code.cc)
    list(PREPEND ARG_PUBLIC ${name}_built)
  endif()
  add_library(${name} STATIC ${ARG_SOURCES})
  target_include_directories(${name} PUBLIC ${KINEVOX_ROOT})
  target_link_libraries(${name} PUBLIC ${ARG_PUBLIC} PRIVATE kinevox_build_options ${ARG_PRIVATE})
endfunction()

# kinevox_test(NAME SOURCES a_test.cc ... LIBRARIES lib ... [LABELS ...] [TIMEOUT s]): a GoogleTest program run by
# CTest as one test (one program per folder, not per case: starting programs is slow on two cores).
function(kinevox_test name)
  cmake_parse_arguments(ARG "" "TIMEOUT" "SOURCES;LIBRARIES;LABELS" ${ARGN})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 120)
  endif()
  add_executable(${name} ${ARG_SOURCES})
  target_include_directories(${name} PRIVATE ${KINEVOX_ROOT})
  target_link_libraries(${name} PRIVATE kinevox_build_options ${ARG_LIBRARIES} GTest::gmock GTest::gtest_main)
  add_test(NAME ${name} COMMAND ${name})
  set_tests_properties(${name} PROPERTIES TIMEOUT ${ARG_TIMEOUT} LABELS "${ARG_LABELS}")
endfunction()

# At the end of a folder of tests: under sanitizers tests take many times as long and measure no time.
macro(kinevox_tests_under_sanitizers)
  if(KINEVOX_SANITIZE)
    get_property(sanitized DIRECTORY PROPERTY TESTS)
    foreach(test IN LISTS sanitized)
      get_test_property(${test} TIMEOUT seconds)
      if(NOT seconds)
        set(seconds 120)
      endif()
      math(EXPR seconds "10 * ${seconds}")
      set_tests_properties(${test} PROPERTIES TIMEOUT ${seconds} RUN_SERIAL FALSE)
    endforeach()
  endif()
endmacro()
