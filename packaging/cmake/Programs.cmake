# The manual's programs (15.3, 13.9) in C, and a network from files.
set(_programs simple_loop canopen_sdo_probe cia402_single_axis_demo cia402_10axis_demo
    mcan_gateway_tx_probe canopen_network)

file(GLOB _sources CONFIGURE_DEPENDS examples/c/*.c)
foreach(_program IN LISTS _programs)
    list(REMOVE_ITEM _sources "${PROJECT_SOURCE_DIR}/examples/c/${_program}.c")
endforeach()
add_library(ecan_programs STATIC ${_sources})
target_compile_definitions(ecan_programs PUBLIC _POSIX_C_SOURCE=200809L)
target_compile_options(ecan_programs PUBLIC -Wall -Wextra -Wpedantic)
target_link_libraries(ecan_programs PUBLIC ecan_igh_host_static)

foreach(_program IN LISTS _programs)
    add_executable(igh_${_program} examples/c/${_program}.c)
    target_link_libraries(igh_${_program} PRIVATE ecan_programs)
    target_link_options(igh_${_program} PRIVATE ${ECAN_LINK_OPTIONS})
endforeach()
list(TRANSFORM _programs PREPEND igh_)
