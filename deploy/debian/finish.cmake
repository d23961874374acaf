# Run by CPack before packing: adds copyright and changelog to each package and compresses manual pages.
file(GLOB staged LIST_DIRECTORIES true ${CPACK_TEMPORARY_DIRECTORY}/*)
execute_process(COMMAND date -R OUTPUT_VARIABLE now OUTPUT_STRIP_TRAILING_WHITESPACE)
foreach(folder ${staged})
  if(NOT IS_DIRECTORY ${folder}/usr)
    continue()
  endif()
  get_filename_component(component ${folder} NAME)
  string(TOUPPER ${component} upper)
  set(package ${CPACK_DEBIAN_${upper}_PACKAGE_NAME})
  set(doc ${folder}/usr/share/doc/${package})
  file(COPY ${CMAKE_CURRENT_LIST_DIR}/copyright DESTINATION ${doc})
  file(WRITE ${doc}/changelog "${package} (${CPACK_PACKAGE_VERSION}) unstable; urgency=medium\n\n\
  * Built from the sources of this version; see CHANGELOG.md there.\n\n\
 -- ${CPACK_PACKAGE_CONTACT}  ${now}\n")
  file(GLOB_RECURSE pages ${folder}/usr/share/man/*.[1-9])
  execute_process(COMMAND gzip -9nf ${doc}/changelog ${pages} COMMAND_ERROR_IS_FATAL ANY)
endforeach()
