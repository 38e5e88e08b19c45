# The programs ecan and ecan-sim with their manual pages and completions. They are programs of cargo,
# which link nothing of the C libraries.
set(ECAN_TOOLS_DIR "" CACHE PATH "Folder of existing ecan and ecan-sim; empty: cargo builds them")

set(_tool_names ecan ecan-sim)
if(ECAN_TOOLS_DIR)
    set(_tools "${ECAN_TOOLS_DIR}")
    add_custom_target(ecan_tools_cargo)
else()
    ecan_cargo_build(ecan_tools PACKAGES ecan-tool FILES ${_tool_names} OUTPUT _tools)
endif()

# As the programs print them; of another processor by CMAKE_CROSSCOMPILING_EMULATOR.
set(_generated "${CMAKE_CURRENT_BINARY_DIR}/tools")
set(_commands)
foreach(_program IN LISTS _tool_names)
    list(JOIN CMAKE_CROSSCOMPILING_EMULATOR " " _run)
    string(APPEND _run " '${_tools}/${_program}'")
    list(APPEND _commands
        COMMAND sh -c "${_run} man '${_generated}/man'"
        COMMAND sh -c "${_run} completions bash >'${_generated}/bash/${_program}'"
        COMMAND sh -c "${_run} completions zsh >'${_generated}/zsh/_${_program}'"
        COMMAND sh -c "${_run} completions fish >'${_generated}/fish/${_program}.fish'")
endforeach()
add_custom_target(ecan_tools ALL
    COMMAND ${CMAKE_COMMAND} -E rm -rf "${_generated}"
    COMMAND ${CMAKE_COMMAND} -E make_directory "${_generated}/man" "${_generated}/bash"
        "${_generated}/zsh" "${_generated}/fish"
    ${_commands}
    COMMENT "Manual pages and completions" VERBATIM)
add_dependencies(ecan_tools ecan_tools_cargo)

list(TRANSFORM _tool_names PREPEND "${_tools}/")
install(PROGRAMS ${_tool_names} DESTINATION ${CMAKE_INSTALL_BINDIR})
foreach(_section IN ITEMS 1 8)
    install(DIRECTORY "${_generated}/man/" DESTINATION ${CMAKE_INSTALL_MANDIR}/man${_section}
        FILES_MATCHING PATTERN "*.${_section}")
endforeach()
install(DIRECTORY "${_generated}/bash/"
    DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)
install(DIRECTORY "${_generated}/zsh/" DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/vendor-completions)
install(DIRECTORY "${_generated}/fish/"
    DESTINATION ${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d)
