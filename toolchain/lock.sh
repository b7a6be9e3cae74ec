#!/bin/bash
# Resolves requirements/*.in into lock files with the hashes of every file, for all supported versions of Python.
set -eu
cd "$(dirname "$0")/requirements"

# A source package could run anything at set-up, so there is only one, which was never released as a wheel: empy 3.
lock() { # OUTPUT OPTION|INPUT...
  uv pip compile --quiet --upgrade --generate-hashes --only-binary :all: --no-header \
    --no-binary empy --custom-compile-command "make lock" --output-file "$@"
}

beside() { # LOCKS OUTPUT OPTION|INPUT...: without what LOCKS install already
  local base=($1) left_out
  shift
  left_out=($(sed -nE 's/^([a-z0-9._-]+)==.*/\1/p' "${base[@]}"))
  lock "$@" "${base[@]/#/--constraints=}" "${left_out[@]/#/--no-emit-package=}"
}

# `make run` installs wheels.lock or installed_ros.lock, `make test` the rest as well, `make setup` and `make test-all` also extras.
universal=(--universal --python-version 3.10)
ubuntu=(--python-version 3.12 --python-platform x86_64-manylinux_2_28)
# colcon asks for them, and needs them for an option only. Where coverage is installed, Numba imports it, in each drill.
unused=(--no-emit-package=pytest-cov --no-emit-package=coverage)
lock installer.lock "${universal[@]}" installer.in
lock wheels.lock "${universal[@]}" "${unused[@]}" --constraints installer.lock --constraints test.in drill.in build.in ros.in
beside wheels.lock rest.lock "${universal[@]}" test.in
beside "wheels.lock rest.lock" extras.lock "${universal[@]}" extras.in
lock installed_ros.lock "${ubuntu[@]}" "${unused[@]}" --constraints installer.lock --constraints test.in drill.in build.in installed_ros.in
beside installed_ros.lock installed_ros_rest.lock "${ubuntu[@]}" test.in
beside "installed_ros.lock installed_ros_rest.lock" installed_ros_extras.lock "${ubuntu[@]}" extras.in
lock browser.lock "${universal[@]}" --constraints wheels.lock --constraints rest.lock --constraints extras.lock browser.in
lock lint.lock "${universal[@]}" --constraints wheels.lock --constraints rest.lock lint.in
lock docs.lock "${universal[@]}" docs.in
beside "wheels.lock rest.lock extras.lock" optional.lock "${universal[@]}" --no-annotate optional.in

# Conditions that hold on every supported machine would only make the lines long.
sed -i -E "s/ and (python_full_version < '3.14'|platform_python_implementation != 'PyPy')//
  s/(python_full_version < '3.14'|implementation_name == 'cpython'|platform_machine == 'x86_64') and //g
  s/( and| ;) sys_platform == 'linux'//" {installer,wheels,rest,extras,browser,lint,docs,optional}.lock
