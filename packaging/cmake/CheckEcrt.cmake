# With ECRT_INCLUDE_DIR: compares the types of the binding with the installed ecrt.h. With
# ECAN_IGH_BUILD_DEMO=AUTO an unusable option is a warning and has no effect (manual 15.3).
set(_severity WARNING)
if(ECAN_IGH_BUILD_DEMO STREQUAL "ON")
    set(_severity FATAL_ERROR)
endif()
if(ECRT_INCLUDE_DIR AND NOT EXISTS "${ECRT_INCLUDE_DIR}/ecrt.h")
    message(${_severity} "ECRT_INCLUDE_DIR is ${ECRT_INCLUDE_DIR}: there is no ecrt.h in it; the "
        "binding is not compared with a header")
elseif(ECRT_INCLUDE_DIR)
    try_compile(_ecrt_fits "${CMAKE_CURRENT_BINARY_DIR}/check_ecrt"
        "${CMAKE_CURRENT_LIST_DIR}/check_ecrt.c"
        CMAKE_FLAGS "-DINCLUDE_DIRECTORIES=${ECRT_INCLUDE_DIR}"
        C_STANDARD 11 C_EXTENSIONS ON
        OUTPUT_VARIABLE _ecrt_output)
    if(NOT _ecrt_fits)
        message(${_severity}
            "The types of ${ECRT_INCLUDE_DIR}/ecrt.h are not those that this SDK was made for "
            "(IgH 1.5 and 1.6); its library must not be used:\n${_ecrt_output}")
    else()
        message(STATUS "The binding fits ${ECRT_INCLUDE_DIR}/ecrt.h")
    endif()
endif()
if(ECRT_LIBRARY AND NOT EXISTS "${ECRT_LIBRARY}")
    message(${_severity} "ECRT_LIBRARY is ${ECRT_LIBRARY}: there is no such file; the default is the "
        "libethercat of the loader")
    set(ECRT_LIBRARY "")
endif()
