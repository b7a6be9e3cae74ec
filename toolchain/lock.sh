#!/bin/bash
# Resolves requirements/*.in into lock files with the hashes of every file, for all supported versions of Python.
set -eu
cd "$(dirname "$0")/requirements"

# A source package could run anything at set-up, so there is only one, which was never released as a wheel: empy 3.
lock() { # OUTPUT OPTION|INPUT...
  uv pip compile --quiet --upgrade --generate-hashes --only-binary :all: --no-header \
    --no-binary empy --custom-compile-command "make lock" --output-file "$@"
}

lock installer.lock --universal --python-version 3.10 installer.in
lock wheels.lock --universal --python-version 3.10 --constraints installer.lock \
  runtime.in test.in build.in ros.in
lock installed_ros.lock --python-version 3.12 --python-platform x86_64-manylinux_2_28 --constraints installer.lock \
  runtime.in test.in build.in installed_ros.in
lock browser.lock --universal --python-version 3.10 --constraints wheels.lock browser.in
lock lint.lock --universal --python-version 3.10 --constraints wheels.lock lint.in
lock docs.lock --universal --python-version 3.10 docs.in

# Without what wheels.lock installs already.
left_out=($(sed -nE 's/^([a-z0-9._-]+)==.*/\1/p' wheels.lock))
lock optional.lock --universal --python-version 3.10 --constraints wheels.lock --no-annotate \
  "${left_out[@]/#/--no-emit-package=}" optional.in

# Conditions that hold on every supported machine would only make the lines long.
sed -i -E "s/ and (python_full_version < '3.14'|platform_python_implementation != 'PyPy')//
  s/(python_full_version < '3.14'|implementation_name == 'cpython'|platform_machine == 'x86_64') and //g
  s/( and| ;) sys_platform == 'linux'//" {installer,wheels,browser,lint,docs,optional}.lock
