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

set(server_scripts postinst prerm postrm conffiles)
set(CPACK_DEBIAN_SERVER_PACKAGE_NAME cellmap-server)
set(CPACK_COMPONENT_SERVER_DESCRIPTION "LiDAR map server and its web viewer")
set(CPACK_DEBIAN_SERVER_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_SERVER_PACKAGE_SUGGESTS cellmap)
set(CPACK_DEBIAN_SERVER_PACKAGE_DEPENDS passwd)
list(TRANSFORM server_scripts PREPEND ${PROJECT_SOURCE_DIR}/server/deploy/)
set(CPACK_DEBIAN_SERVER_PACKAGE_CONTROL_EXTRA ${server_scripts})
# The unit was configured for the prefix of this build; a package's programs are in /usr/bin. Its settings are dpkg's to keep.
file(WRITE ${CMAKE_BINARY_DIR}/server_package.cmake [[
file(GLOB_RECURSE units "${CPACK_TEMPORARY_DIRECTORY}/*/cellmapd.service")
foreach(unit ${units})
  file(READ ${unit} text)
  string(REGEX REPLACE "ExecStart=[^ ]*/cellmapd" "ExecStart=/usr/bin/cellmapd" text "${text}")
  file(WRITE ${unit} "${text}")
  string(REGEX REPLACE "/usr/lib/systemd/system/cellmapd.service$" "" package ${unit})
  file(COPY ${package}/usr/share/cellmap/cellmapd.conf DESTINATION ${package}/etc/cellmap)
endforeach()
]])
set(CPACK_PRE_BUILD_SCRIPTS ${CMAKE_BINARY_DIR}/server_package.cmake)

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
set(CPACK_DEBIAN_PYTHON_PACKAGE_CONTROL_EXTRA
  ${PROJECT_SOURCE_DIR}/client/python/debian/postinst ${PROJECT_SOURCE_DIR}/client/python/debian/prerm)
include(CPack)

# Debian asks every package for its terms.
foreach(component ${CPACK_COMPONENTS_ALL})
  string(TOUPPER ${component} name)
  install(FILES ${PROJECT_SOURCE_DIR}/server/deploy/copyright
    DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${CPACK_DEBIAN_${name}_PACKAGE_NAME}
    COMPONENT ${component})
endforeach()

add_custom_target(packages COMMAND ${CMAKE_CPACK_COMMAND} -G DEB
  DEPENDS cellmap_cli cellmapd cellmap_client USES_TERMINAL COMMENT "Writing Debian packages")
if(TARGET man)
  add_dependencies(packages man)
endif()
