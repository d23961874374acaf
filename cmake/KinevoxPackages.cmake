# Debian packages by CPack, one per component; `deploy/package` builds them. Install rules name their component: server,
# client, viewer, exhibit or python. deploy/debian/finish.cmake adds copyright, changelog and compressed manual pages.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME kinevox)
set(CPACK_PACKAGE_VENDOR "Kinevox")
set(CPACK_PACKAGE_CONTACT "The Kinevox authors <kinevox@users.noreply.kinevox.example>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "markerless motion capture")
set(CPACK_PACKAGE_DIRECTORY ${CMAKE_BINARY_DIR}/packages)
set(CPACK_OUTPUT_FILE_PREFIX ${CPACK_PACKAGE_DIRECTORY})
set(CPACK_SET_DESTDIR ON)          # units, rules and the configuration are outside the prefix
set(CPACK_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_PRE_BUILD_SCRIPTS ${PROJECT_SOURCE_DIR}/deploy/debian/finish.cmake)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
  OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)

set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_ALL server client python)
if(TARGET kinevox-viewer)
  list(APPEND CPACK_COMPONENTS_ALL viewer)
endif()
if(TARGET kinevox_exhibit)
  list(APPEND CPACK_COMPONENTS_ALL exhibit)
endif()
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_PACKAGE_PRIORITY optional)

set(CPACK_DEBIAN_SERVER_PACKAGE_NAME kinevox-server)
set(CPACK_DEBIAN_SERVER_PACKAGE_SECTION science)
set(CPACK_DEBIAN_SERVER_PACKAGE_DEPENDS "adduser, kinevox-client, python3:any")
set(CPACK_DEBIAN_SERVER_PACKAGE_RECOMMENDS "python3-matplotlib, python3-numpy, python3-opencv, udev")
set(CPACK_DEBIAN_SERVER_PACKAGE_CONTROL_EXTRA
  ${PROJECT_SOURCE_DIR}/deploy/debian/server/postinst ${PROJECT_SOURCE_DIR}/deploy/debian/server/prerm
  ${PROJECT_SOURCE_DIR}/deploy/debian/server/postrm ${PROJECT_SOURCE_DIR}/deploy/debian/server/conffiles)
set(CPACK_COMPONENT_SERVER_DESCRIPTION "markerless motion capture: the daemon\n\
 Captures synchronised video from several cameras (GigE Vision, USB3 Vision),\n\
 reconstructs the volume of the subject, fits a body model and streams both over\n\
 gRPC in real time. Includes the tools for recordings and calibration.")

set(CPACK_DEBIAN_CLIENT_PACKAGE_NAME kinevox-client)
set(CPACK_DEBIAN_CLIENT_PACKAGE_SECTION science)
set(CPACK_DEBIAN_CLIENT_PACKAGE_SUGGESTS "kinevox-viewer, python3-kinevox")
set(CPACK_COMPONENT_CLIENT_DESCRIPTION "markerless motion capture: the command line\n\
 Controls and monitors a capture daemon, streams joint angles and volumes to\n\
 the terminal, and forwards poses to other programs.")

set(CPACK_DEBIAN_VIEWER_PACKAGE_NAME kinevox-viewer)
set(CPACK_DEBIAN_VIEWER_PACKAGE_SECTION science)
set(CPACK_DEBIAN_VIEWER_PACKAGE_RECOMMENDS "libgl1-mesa-dri, qt6-qpa-plugins")
set(CPACK_COMPONENT_VIEWER_DESCRIPTION "markerless motion capture: the viewer for coaches\n\
 Shows volume, skeleton, cameras and joint angles of a capture daemon, and\n\
 its recordings.")

set(CPACK_DEBIAN_EXHIBIT_PACKAGE_NAME kinevox-exhibit)
set(CPACK_DEBIAN_EXHIBIT_PACKAGE_SECTION science)
set(CPACK_COMPONENT_EXHIBIT_DESCRIPTION "markerless motion capture: the exhibit page\n\
 A gateway that serves a page to browsers and streams poses, volumes and\n\
 silhouettes of a capture daemon to it, never camera images.")

set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-kinevox)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
set(CPACK_DEBIAN_PYTHON_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SHLIBDEPS OFF)
set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS
  "python3:any (>= 3.11), python3-grpcio (>= 1.51), python3-numpy, python3-protobuf (>= 3.21), python3-zstandard")
set(CPACK_DEBIAN_PYTHON_PACKAGE_CONTROL_EXTRA
  ${PROJECT_SOURCE_DIR}/deploy/debian/python/postinst ${PROJECT_SOURCE_DIR}/deploy/debian/python/prerm)
set(CPACK_COMPONENT_PYTHON_DESCRIPTION "markerless motion capture: the client for Python\n\
 Poses, volumes and recordings of a capture daemon as NumPy arrays, blocking\n\
 or with asyncio.")
include(CPack)
