# The ROS wheels export targets with paths of the machine that built them. Each is replaced by this machine's, or left out.
cmake_language(DEFER CALL repair_wheel_targets)

function(repair_wheel_targets)
  if(NOT TARGET Python3::NumPy)
    find_package(Python3 REQUIRED COMPONENTS Interpreter Development NumPy)
  endif()
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_property(folders TARGET ${target} PROPERTY INTERFACE_INCLUDE_DIRECTORIES)
    get_property(libraries TARGET ${target} PROPERTY INTERFACE_LINK_LIBRARIES)
    if(target MATCHES "__rosidl_generator_py$" AND folders)
      # CMake rejects folders that do not exist.
      list(FILTER folders EXCLUDE REGEX "^/opt/python/")
      list(APPEND folders ${Python3_INCLUDE_DIRS} ${Python3_NumPy_INCLUDE_DIRS})
      set_property(TARGET ${target} PROPERTY INTERFACE_INCLUDE_DIRECTORIES "${folders}")
      # Python has loaded libpython before these libraries. A program in C++ has not, none of them names it, and a linker
      # leaves out what the program itself does not call.
      set(program "$<STREQUAL:$<TARGET_PROPERTY:TYPE>,EXECUTABLE>")
      list(APPEND libraries "$<${program}:${Python3_LIBRARIES}>")
      set_property(TARGET ${target} PROPERTY INTERFACE_LINK_OPTIONS "$<${program}:LINKER:--no-as-needed>")
    endif()
    if(libraries)
      # Of libfastrtps and libtracetools: the wheels contain both under other names, which only these two need.
      list(FILTER libraries EXCLUDE REGEX "^(/usr/lib64/libtinyxml2.so|lttng-ust)$")
      set_property(TARGET ${target} PROPERTY INTERFACE_LINK_LIBRARIES "${libraries}")
    endif()
  endforeach()
endfunction()
