# Not a cross-compilation: a toolchain file is the one hook that an environment variable (CMAKE_TOOLCHAIN_FILE) can set.
set(CMAKE_PROJECT_INCLUDE "${CMAKE_CURRENT_LIST_DIR}/repair_wheel_targets.cmake")
# The wheels have no rclcpp. Without one beside them nobody compiles C++ programs.
find_file(RCLCPP share/rclcpp/package.xml PATHS ENV AMENT_PREFIX_PATH NO_DEFAULT_PATH)
if(NOT RCLCPP)
  set(RPUD_MSGS_PYTHON_ONLY ON)
endif()
