# Compares what LIBRARY exports (by NM) with what its version script MAP announces.
execute_process(COMMAND ${NM} -D --defined-only ${LIBRARY} OUTPUT_VARIABLE _found
    COMMAND_ERROR_IS_FATAL ANY)
string(REGEX MATCHALL "(ecan|igh)_[a-z0-9_]+@@ECAN_[A-Z0-9_.]+" _exported "${_found}")

file(STRINGS ${MAP} _lines)
set(_announced)
foreach(_line IN LISTS _lines)
    # A list holds no lone semicolon, so file(STRINGS) has kept it escaped.
    if(_line MATCHES "^(ECAN_[A-Z0-9_.]+) {")
        set(_node ${CMAKE_MATCH_1})
    elseif(_line MATCHES "^ +((ecan|igh)_[a-z0-9_]+)")
        list(APPEND _announced "${CMAKE_MATCH_1}@@${_node}")
    endif()
endforeach()

set(_missing ${_announced})
list(REMOVE_ITEM _missing ${_exported})
set(_unknown ${_exported})
list(REMOVE_ITEM _unknown ${_announced})
if(_missing OR _unknown)
    message(FATAL_ERROR "${LIBRARY}\n  announced, not exported: ${_missing}\n"
        "  exported, not announced: ${_unknown}")
endif()
list(LENGTH _exported _count)
message(STATUS "${_count} functions, as announced")
