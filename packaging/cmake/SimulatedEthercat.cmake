# The simulated libethercat: build/sim/libethercat.so.1, for C masters that call ecrt_* themselves.
#
#     LD_LIBRARY_PATH=build/sim ./my_master
#
# It is never installed: the loader must not find it without LD_LIBRARY_PATH.
# The bridges of a scenario have threads, so the code stays loaded (nodelete).
ecan_cargo_build(simulated_ethercat PACKAGES ecan-sim-ethercat FILES libethercat_sim.a
    OUTPUT _sim_directory)
set(_sim_archive "${_sim_directory}/libethercat_sim.a")
set(_sim_map "${PROJECT_SOURCE_DIR}/capi/sim-ethercat/libethercat.map")
add_library(simulated_ethercat SHARED "${CMAKE_CURRENT_BINARY_DIR}/empty.c")
add_dependencies(simulated_ethercat simulated_ethercat_cargo)
target_link_libraries(simulated_ethercat PRIVATE
    "-Wl,--whole-archive" "${_sim_archive}" "-Wl,--no-whole-archive" ${ECAN_SYSTEM_LIBRARIES})
target_link_options(simulated_ethercat PRIVATE
    "-Wl,--version-script=${_sim_map}" "-Wl,-z,nodelete" ${ECAN_LINK_OPTIONS})
set_target_properties(simulated_ethercat PROPERTIES
    OUTPUT_NAME ethercat VERSION 1.6.2 SOVERSION 1
    LIBRARY_OUTPUT_DIRECTORY "${CMAKE_CURRENT_BINARY_DIR}/sim"
    LINK_DEPENDS "${_sim_archive};${_sim_map}")
