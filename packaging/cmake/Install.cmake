# Programs, scripts, headers, libraries, pkg-config files, a CMake package, the documents and the licences.
set(_libraries ecan_mcan_host)
if(TARGET ecan_igh_host)
    list(APPEND _libraries ecan_igh_host)
endif()

file(RELATIVE_PATH _pc_to_prefix
    "/prefix/${CMAKE_INSTALL_LIBDIR}/pkgconfig" "/prefix")
string(REGEX REPLACE "/$" "" _pc_to_prefix "${_pc_to_prefix}")

install(FILES ${_headers} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
if(TARGET ecan_igh_host)
    # C++17
    install(FILES include/ecan_lite.hpp DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
    install(DIRECTORY include/ecan_lite DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
endif()
install(FILES API.md CHANGELOG.md LICENSE-APACHE LICENSE-MIT NOTICE DESTINATION ${CMAKE_INSTALL_DOCDIR})
# In the layout of the repository, in which they refer to each other.
# SUMMARY.md is the table of contents of the site.
install(DIRECTORY docs DESTINATION ${CMAKE_INSTALL_DOCDIR}
    FILES_MATCHING PATTERN "*.md" PATTERN "*.svg" PATTERN "SUMMARY.md" EXCLUDE)
install(DIRECTORY examples/python DESTINATION ${CMAKE_INSTALL_DOCDIR}/examples
    FILES_MATCHING PATTERN "*.py")
install(FILES examples/grafana/ecan-lite.json DESTINATION ${CMAKE_INSTALL_DOCDIR}/examples/grafana)
install(DIRECTORY examples/zenoh DESTINATION ${CMAKE_INSTALL_DOCDIR}/examples USE_SOURCE_PERMISSIONS
    FILES_MATCHING PATTERN "*.json5" PATTERN "*.sh" PATTERN "*.service")
install(FILES packaging/wireshark/README.md packaging/wireshark/ecan_pdo.lua
    DESTINATION ${CMAKE_INSTALL_DOCDIR}/packaging/wireshark)
# Messages name these scripts.
install(PROGRAMS scripts/ecan_sii_sm_layout.sh scripts/setup_host.sh
    DESTINATION ${CMAKE_INSTALL_BINDIR})
if(TARGET ecan_igh_host)
    install(TARGETS ${_programs} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
endif()
install(TARGETS ${_libraries} LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR})
foreach(_library IN LISTS _libraries)
    install(FILES "${CMAKE_CURRENT_BINARY_DIR}/lib${_library}.a"
        DESTINATION ${CMAKE_INSTALL_LIBDIR})
    if(_library STREQUAL "ecan_igh_host")
        set(_description "ECAN-Lite: Adapter, MCAN Port and CiA 402 on the IgH EtherCAT master")
        set(_requires "ecan_mcan_host = ${PROJECT_VERSION}")
    else()
        set(_description "ECAN-Lite: the process data protocol")
        set(_requires)
    endif()
    configure_file(packaging/cmake/ecan.pc.in "${_library}.pc" @ONLY)
    install(FILES "${CMAKE_CURRENT_BINARY_DIR}/${_library}.pc"
        DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
endforeach()

set(_package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/EcanLite)
configure_package_config_file(packaging/cmake/EcanLiteConfig.cmake.in EcanLiteConfig.cmake
    INSTALL_DESTINATION ${_package_dir} PATH_VARS CMAKE_INSTALL_INCLUDEDIR CMAKE_INSTALL_LIBDIR)
write_basic_package_version_file("${CMAKE_CURRENT_BINARY_DIR}/EcanLiteConfigVersion.cmake"
    COMPATIBILITY SameMinorVersion)
install(FILES
    "${CMAKE_CURRENT_BINARY_DIR}/EcanLiteConfig.cmake"
    "${CMAKE_CURRENT_BINARY_DIR}/EcanLiteConfigVersion.cmake"
    DESTINATION ${_package_dir})
