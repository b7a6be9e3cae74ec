# Not a cross-compilation: a toolchain file is the one hook that an environment variable (CMAKE_TOOLCHAIN_FILE) can set.
set(CMAKE_PROJECT_INCLUDE "${CMAKE_CURRENT_LIST_DIR}/repair_wheel_targets.cmake")
# Nobody compiles C++ programs beside the wheels.
set(RPUD_MSGS_PYTHON_ONLY ON)
