# The message packages in the ROS wheels export Python targets with the include folders of the machine that built
# them. CMake rejects folders that do not exist, so each is replaced by this machine's.
cmake_language(DEFER CALL repair_wheel_targets)

function(repair_wheel_targets)
  if(NOT TARGET Python3::NumPy)
    find_package(Python3 REQUIRED COMPONENTS Interpreter Development NumPy)
  endif()
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  list(FILTER targets INCLUDE REGEX "__rosidl_generator_py$")
  foreach(target IN LISTS targets)
    get_target_property(folders ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(folders)
      list(FILTER folders EXCLUDE REGEX "^/opt/python/")
      list(APPEND folders ${Python3_INCLUDE_DIRS} ${Python3_NumPy_INCLUDE_DIRS})
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${folders}")
    endif()
  endforeach()
endfunction()
