# With ECRT_INCLUDE_DIR: compares the types of the binding with the installed ecrt.h.
if(ECRT_INCLUDE_DIR)
    if(NOT EXISTS "${ECRT_INCLUDE_DIR}/ecrt.h")
        message(FATAL_ERROR "ECRT_INCLUDE_DIR is ${ECRT_INCLUDE_DIR}: there is no ecrt.h in it")
    endif()
    try_compile(_ecrt_fits "${CMAKE_CURRENT_BINARY_DIR}/check_ecrt"
        "${CMAKE_CURRENT_LIST_DIR}/check_ecrt.c"
        CMAKE_FLAGS "-DINCLUDE_DIRECTORIES=${ECRT_INCLUDE_DIR}"
        C_STANDARD 11 C_EXTENSIONS ON
        OUTPUT_VARIABLE _ecrt_output)
    if(NOT _ecrt_fits)
        message(FATAL_ERROR
            "The types of ${ECRT_INCLUDE_DIR}/ecrt.h are not those that this SDK was made for "
            "(IgH 1.5.2 to 1.6):\n${_ecrt_output}")
    endif()
    message(STATUS "The binding fits ${ECRT_INCLUDE_DIR}/ecrt.h")
endif()
if(ECRT_LIBRARY AND NOT EXISTS "${ECRT_LIBRARY}")
    message(FATAL_ERROR "ECRT_LIBRARY is ${ECRT_LIBRARY}: there is no such file")
endif()
