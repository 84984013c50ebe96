# Debian packages: `cmake --build --preset release --target packages` writes them into the build tree.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME cellmap)
set(CPACK_PACKAGE_CONTACT "CELLmap maintainers <cellmap@localhost>")
set(CPACK_PACKAGE_VENDOR CELLmap)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL server client dev python)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

set(CPACK_DEBIAN_SERVER_PACKAGE_NAME cellmap-server)
set(CPACK_COMPONENT_SERVER_DESCRIPTION "LiDAR map server and its web viewer")
set(CPACK_DEBIAN_SERVER_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_SERVER_PACKAGE_SUGGESTS cellmap)
set(CPACK_DEBIAN_SERVER_PACKAGE_CONTROL_EXTRA ${PROJECT_SOURCE_DIR}/server/deploy/postinst)
# The unit was configured for the prefix of this build; a package's programs are in /usr/bin.
file(WRITE ${CMAKE_BINARY_DIR}/unit_of_package.cmake [[
file(GLOB_RECURSE units "${CPACK_TEMPORARY_DIRECTORY}/*/cellmapd.service")
foreach(unit ${units})
  file(READ ${unit} text)
  string(REGEX REPLACE "ExecStart=[^ ]*/cellmapd" "ExecStart=/usr/bin/cellmapd" text "${text}")
  file(WRITE ${unit} "${text}")
endforeach()
]])
set(CPACK_PRE_BUILD_SCRIPTS ${CMAKE_BINARY_DIR}/unit_of_package.cmake)

set(CPACK_DEBIAN_CLIENT_PACKAGE_NAME cellmap)
set(CPACK_COMPONENT_CLIENT_DESCRIPTION "Elastic, lightweight LiDAR maps from the command line")
set(CPACK_DEBIAN_CLIENT_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_CLIENT_PACKAGE_RECOMMENDS cellmap-server)

set(CPACK_DEBIAN_DEV_PACKAGE_NAME libcellmap-dev)
set(CPACK_COMPONENT_DEV_DESCRIPTION "C++ libraries, headers and schema of CELLmap")
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS
  "libeigen3-dev, libflatbuffers-dev, libzstd-dev, libssl-dev, libxxhash-dev, libceres-dev, libtbb-dev, libembree-dev, libgeographiclib-dev, libsqlite3-dev, libsqlitecpp-dev, libhwy-dev, libcpp-httplib-dev, nlohmann-json3-dev")

set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-cellmap)
set(CPACK_COMPONENT_PYTHON_DESCRIPTION "CELLmap from Python, as numpy arrays")
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
set(CPACK_DEBIAN_PYTHON_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS "python3 (>= 3.11), python3-numpy, python3-zstandard, python3-xxhash")
set(CPACK_DEBIAN_PYTHON_PACKAGE_SUGGESTS python3-matplotlib)
include(CPack)

add_custom_target(packages COMMAND ${CMAKE_CPACK_COMMAND} -G DEB
  DEPENDS cellmap_cli cellmapd cellmap_client USES_TERMINAL COMMENT "Writing Debian packages")
if(TARGET man)
  add_dependencies(packages man)
endif()
