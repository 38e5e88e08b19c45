# Builds the C libraries from their Rust crates.
#
# cargo makes the static library. The shared one is linked from it here, since its symbols are
# versioned: rustc's own link of a cdylib takes no version script.

find_program(ECAN_CARGO cargo HINTS "$ENV{HOME}/.cargo/bin" REQUIRED)
find_package(Threads REQUIRED)

set(_rust_target "")
if(CMAKE_CROSSCOMPILING)
    set(_rust_target "${CMAKE_SYSTEM_PROCESSOR}-unknown-linux-gnu")
endif()
set(ECAN_RUST_TARGET "${_rust_target}" CACHE STRING
    "Target of rustc that fits CMAKE_C_COMPILER; empty: this machine")

# System libraries of a Rust static library.
set(ECAN_SYSTEM_LIBRARIES Threads::Threads ${CMAKE_DL_LIBS} m)

# The addresses of other libraries' functions are resolved and write-protected at the load.
set(ECAN_LINK_OPTIONS
    "-Wl,--gc-sections" "-Wl,--no-undefined" "-Wl,-z,relro,-z,now" "-Wl,-z,noexecstack"
    "$<$<CONFIG:Release>:-Wl,--strip-debug>")

# Flags of rustc that keep the paths of this machine out of the libraries.
function(ecan_rust_flags output)
    set(_cargo_home "$ENV{CARGO_HOME}")
    if(NOT _cargo_home)
        set(_cargo_home "$ENV{HOME}/.cargo")
    endif()
    get_filename_component(_bin "${ECAN_CARGO}" DIRECTORY)
    find_program(ECAN_RUSTC rustc HINTS "${_bin}" REQUIRED)
    execute_process(COMMAND ${ECAN_RUSTC} --print sysroot WORKING_DIRECTORY "${PROJECT_SOURCE_DIR}"
        OUTPUT_VARIABLE _sysroot OUTPUT_STRIP_TRAILING_WHITESPACE)
    # The last prefix that matches counts.
    set(_flags "--remap-path-prefix=${_cargo_home}=/cargo"
        "--remap-path-prefix=${_sysroot}=/rust"
        "--remap-path-prefix=${ECAN_CARGO_TARGET_DIR}=/target"
        "--remap-path-prefix=${PROJECT_SOURCE_DIR}=/ecan-lite")
    separate_arguments(_own UNIX_COMMAND "$ENV{RUSTFLAGS}")
    list(APPEND _own ${_flags})
    string(ASCII 31 _separator)
    list(JOIN _own "${_separator}" _joined)
    set(${output} "${_joined}" PARENT_SCOPE)
endfunction()
ecan_rust_flags(ECAN_RUST_FLAGS)

# Before 1.0 each minor version may be incompatible (docs/VERSIONS.md).
if(PROJECT_VERSION_MAJOR EQUAL 0)
    set(ECAN_SOVERSION ${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
else()
    set(ECAN_SOVERSION ${PROJECT_VERSION_MAJOR})
endif()

# cargo's release build of PACKAGES with further FLAGS; FILES are what it makes, and OUTPUT gets the
# directory in which they are.
function(ecan_cargo_build target)
    cmake_parse_arguments(_arg "" "OUTPUT" "PACKAGES;FILES;FLAGS" ${ARGN})
    if(ECAN_BUILT_LIBRARIES)
        add_custom_target(${target}_cargo)
        set(${_arg_OUTPUT} "${ECAN_BUILT_LIBRARIES}" PARENT_SCOPE)
        return()
    endif()
    set(_directory "${ECAN_CARGO_TARGET_DIR}/release")
    set(_environment "CARGO_TARGET_DIR=${ECAN_CARGO_TARGET_DIR}"
        "CARGO_ENCODED_RUSTFLAGS=${ECAN_RUST_FLAGS}")
    if(ECRT_LIBRARY)
        list(APPEND _environment "ECAN_DEFAULT_ECRT=${ECRT_LIBRARY}")
    endif()
    if(ECAN_RUST_TARGET)
        set(_directory "${ECAN_CARGO_TARGET_DIR}/${ECAN_RUST_TARGET}/release")
        string(TOUPPER "${ECAN_RUST_TARGET}" _name)
        string(REPLACE "-" "_" _name "${_name}")
        list(APPEND _environment "CARGO_TARGET_${_name}_LINKER=${CMAKE_C_COMPILER}")
        list(APPEND _arg_FLAGS --target ${ECAN_RUST_TARGET})
    endif()
    list(TRANSFORM _arg_PACKAGES PREPEND "--package=")
    list(TRANSFORM _arg_FILES PREPEND "${_directory}/")
    # cargo decides what is out of date.
    add_custom_target(${target}_cargo ALL
        COMMAND ${CMAKE_COMMAND} -E env ${_environment} ${ECAN_CARGO} build --release --locked --quiet
            ${_arg_PACKAGES} ${_arg_FLAGS}
        WORKING_DIRECTORY "${PROJECT_SOURCE_DIR}"
        BYPRODUCTS ${_arg_FILES}
        COMMENT "cargo build ${target}"
        USES_TERMINAL VERBATIM)
    set(${_arg_OUTPUT} "${_directory}" PARENT_SCOPE)
endfunction()

# A library of the SDK: <name> (shared) and <name>_static, on top of the library NEEDS.
function(ecan_add_library name)
    cmake_parse_arguments(_arg "" "PACKAGE;NEEDS" "FLAGS" ${ARGN})
    ecan_cargo_build(${name} PACKAGES ${_arg_PACKAGE} FILES lib${name}.a FLAGS ${_arg_FLAGS}
        OUTPUT _directory)
    set(_archive "${_directory}/lib${name}.a")
    set(_static "${CMAKE_CURRENT_BINARY_DIR}/lib${name}.a")
    set(_map "${PROJECT_SOURCE_DIR}/capi/lib${name}.map")
    set(_prelink "${PROJECT_SOURCE_DIR}/packaging/cmake/PrelinkArchive.cmake")
    add_custom_command(OUTPUT "${_static}"
        COMMAND ${CMAKE_COMMAND} "-DCC=${CMAKE_C_COMPILER}" "-DOBJCOPY=${CMAKE_OBJCOPY}"
            "-DAR=${CMAKE_AR}" "-DARCHIVE=${_archive}" "-DMAP=${_map}" "-DOUTPUT=${_static}"
            "-DSTRIP=$<$<CONFIG:Release>:--strip-debug>" -P "${_prelink}"
        DEPENDS ${name}_cargo "${_archive}" "${_map}" "${_prelink}")
    add_custom_target(${name}_archive ALL DEPENDS "${_static}")
    set(_needs_static)
    if(_arg_NEEDS)
        set(_needs_static ${_arg_NEEDS}_static)
    endif()

    add_library(${name}_static STATIC IMPORTED GLOBAL)
    add_dependencies(${name}_static ${name}_archive)
    set_target_properties(${name}_static PROPERTIES
        IMPORTED_LOCATION "${_static}"
        INTERFACE_INCLUDE_DIRECTORIES "${PROJECT_SOURCE_DIR}/include"
        INTERFACE_LINK_LIBRARIES "${_needs_static};${ECAN_SYSTEM_LIBRARIES}")

    file(WRITE "${CMAKE_CURRENT_BINARY_DIR}/empty.c" "typedef int ecan_empty;\n")
    add_library(${name} SHARED "${CMAKE_CURRENT_BINARY_DIR}/empty.c")
    target_compile_options(${name} PRIVATE "-ffile-prefix-map=${CMAKE_CURRENT_BINARY_DIR}=.")
    add_dependencies(${name} ${name}_archive)
    target_include_directories(${name} INTERFACE
        "$<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include>"
        "$<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>")
    # PUBLIC: an application calls the functions of both.
    target_link_libraries(${name} PRIVATE
        "-Wl,--whole-archive" "${_static}" "-Wl,--no-whole-archive"
        PUBLIC ${_arg_NEEDS} PRIVATE ${ECAN_SYSTEM_LIBRARIES})
    target_link_options(${name} PRIVATE
        "-Wl,--version-script=${_map}" ${ECAN_LINK_OPTIONS})
    set_target_properties(${name} PROPERTIES
        # The libraries find each other wherever they are installed.
        BUILD_WITH_INSTALL_RPATH ON
        INSTALL_RPATH "$<$<BOOL:${_arg_NEEDS}>:$ORIGIN>"
        VERSION ${PROJECT_VERSION}
        SOVERSION ${ECAN_SOVERSION}
        LINK_DEPENDS "${_static};${_map}")
endfunction()
