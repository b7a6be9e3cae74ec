# Stages: dependencies (downloads and messages), kernels (the built package), tests. docs/ci.md shows how to use them.
FROM debian:12 AS dependencies
RUN apt-get update \
    && apt-get install --no-install-recommends --yes ca-certificates g++ git make python3-dev python3-venv \
    && rm -rf /var/lib/apt/lists/*
# For the tests of pages. Ubuntu's is a snap, which no container runs.
RUN apt-get update \
    && apt-get install --no-install-recommends --yes chromium fonts-liberation \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /rpud_sim
# Only what the downloads and the messages depend on: a change of the Python sources leaves this layer as it is.
COPY Makefile colcon_defaults.yaml ./
COPY toolchain toolchain
COPY msg_defs msg_defs
RUN make install/.messages .venv/.extras && rm -rf /root/.cache/pip

FROM dependencies AS kernels
COPY . .
# It compiles the model as well.
RUN make setup

FROM kernels AS tests
CMD [".ci/run"]
