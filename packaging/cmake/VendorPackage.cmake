# The tree of the vendor's package (manual 15.1) on top of the libraries, for builds that list its files:
# include, src, and lib/libethercat.so, which makes `-lethercat` link the SDK.

# Writes libethercat.so into DIRECTORY, a linker script: the static libraries are in the folder LIBRARIES
# relative to it. Programs that call ecrt_* themselves also need the master's own library, ECRT_LIBRARY.
function(ecan_write_ethercat_script directory libraries)
    set(_master "")
    if(ECRT_LIBRARY)
        set(_master " AS_NEEDED ( ${ECRT_LIBRARY} )")
    endif()
    file(WRITE "${directory}/libethercat.so" "/* GNU ld script */
INPUT ( ${libraries}/libecan_igh_host.a ${libraries}/libecan_mcan_host.a -lpthread -ldl -lm${_master} )
")
endfunction()

set(_tree "${CMAKE_CURRENT_BINARY_DIR}/vendor-package")
file(MAKE_DIRECTORY "${_tree}")
file(CREATE_LINK "${PROJECT_SOURCE_DIR}/include" "${_tree}/include" SYMBOLIC)
file(CREATE_LINK "${PROJECT_SOURCE_DIR}/packaging/vendor-package/src" "${_tree}/src" SYMBOLIC)
ecan_write_ethercat_script("${_tree}/lib" ../..)

set(_installed ${CMAKE_INSTALL_DATADIR}/ecan-lite/vendor-package)
file(RELATIVE_PATH _to_include "/prefix/${_installed}" "/prefix/${CMAKE_INSTALL_INCLUDEDIR}")
file(RELATIVE_PATH _to_libraries "/prefix/${_installed}/lib" "/prefix/${CMAKE_INSTALL_LIBDIR}")
ecan_write_ethercat_script("${CMAKE_CURRENT_BINARY_DIR}/installed-script" ${_to_libraries})
file(CREATE_LINK ${_to_include} "${CMAKE_CURRENT_BINARY_DIR}/installed-script/include" SYMBOLIC)
install(DIRECTORY packaging/vendor-package/src DESTINATION ${_installed})
install(FILES "${CMAKE_CURRENT_BINARY_DIR}/installed-script/libethercat.so" DESTINATION ${_installed}/lib)
install(FILES "${CMAKE_CURRENT_BINARY_DIR}/installed-script/include" DESTINATION ${_installed})
