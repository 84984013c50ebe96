# Several sources as one translation unit: most of compiling a file here is parsing Eigen, the JSON and the HTTP library
# and making code of their templates, which a group does once. On in the presets that build everything; off in `debug`,
# for editing: a change of one file compiles one file there, and tools find each file in compile_commands.json.
option(CELLMAP_UNITY "Compile the sources of a folder as one" OFF)
if(CELLMAP_UNITY)
  # GCC takes a source that another one includes for a header.
  add_compile_options($<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>)
endif()

# cellmap_group_sources(<target>): one unit a folder, so that helpers in anonymous namespaces meet those of their own
# room only, and a new file changes no other room. Files with compile options of their own stay alone (CMake sees to it).
function(cellmap_group_sources target)
  if(NOT CELLMAP_UNITY)
    return()
  endif()
  set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_MODE GROUP)
  get_target_property(sources ${target} SOURCES)
  foreach(source IN LISTS sources)
    cmake_path(GET source PARENT_PATH folder)
    cmake_path(GET folder FILENAME room)
    set_property(SOURCE ${source} PROPERTY UNITY_GROUP ${room})
  endforeach()
endfunction()
