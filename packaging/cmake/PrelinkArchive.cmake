# Makes OUTPUT, a static library of one object whose only global symbols are those of the version
# script MAP, from cargo's static library ARCHIVE, with the tools CC, OBJCOPY and AR. STRIP is a further
# option of OBJCOPY, or empty.
#
# cargo's archive holds the whole Rust runtime with global symbols. With local ones a program may link
# several Rust libraries, with --whole-archive as well.
cmake_minimum_required(VERSION 3.16)
function(run)
    execute_process(COMMAND ${ARGN} RESULT_VARIABLE _result)
    if(NOT _result EQUAL 0)
        message(FATAL_ERROR "failed with ${_result}: ${ARGN}")
    endif()
endfunction()

string(REGEX REPLACE "[.]a$" ".o" _object "${OUTPUT}")
file(STRINGS "${MAP}" _lines)
set(_names)
set(_roots)
foreach(_line IN LISTS _lines)
    if(_line MATCHES "^ +((ecan|igh)_[a-z0-9_]+)")
        string(APPEND _names "${CMAKE_MATCH_1}\n")
        list(APPEND _roots "-Wl,-u,${CMAKE_MATCH_1}")
    endif()
endforeach()
file(WRITE "${OUTPUT}.symbols" "${_names}")
file(REMOVE "${OUTPUT}")

run(${CC} -r -nostdlib -o "${_object}" -Wl,--gc-sections ${_roots}
    -Wl,--whole-archive "${ARCHIVE}" -Wl,--no-whole-archive)
# Bitcode for an optimisation at link time is of no use to a C compiler, and confuses its plugins.
run(${OBJCOPY} ${STRIP} --remove-section=.llvmbc --remove-section=.llvmcmd
    "--keep-global-symbols=${OUTPUT}.symbols" "${_object}")
run(${AR} rcsD "${OUTPUT}" "${_object}")
file(REMOVE "${_object}" "${OUTPUT}.symbols")
