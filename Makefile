SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DELETE_ON_ERROR:
.DEFAULT_GOAL := setup

DURATION ?= 10
BAG ?= bags/$(shell date +%Y-%m-%d-%H%M%S)
PYTEST_ARGS ?=
BENCH_ARGS ?=
KILLS ?= 1000
PYTHONS ?=
RUNS ?= 100
STARTS ?= 500

# An installed ROS is used in place of the wheels. ROS_PREFIX= (empty) asks for the wheels all the same.
ROS_PREFIX ?= $(wildcard /opt/ros/jazzy)
LOCK := toolchain/requirements/$(if $(ROS_PREFIX),installed_ros,wheels).lock
REST := toolchain/requirements/$(if $(ROS_PREFIX),installed_ros_,)rest.lock
EXTRAS := toolchain/requirements/$(if $(ROS_PREFIX),installed_ros_,)extras.lock

# Python compiles a module when it is first imported: pip would do it for all, most of which are never imported here.
PIP_INSTALL := .venv/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes --no-deps --no-compile
# uv needs a third of the time. Behind a proxy that has its own certificates it must use those of the system. It does not read
# pip's configuration, such as the address of a mirror: then pip installs.
UV_INSTALL = .venv/bin/python -m uv --quiet $(1) pip install --python .venv/bin/python --require-hashes --no-deps $(2) 2>/dev/null
INSTALL = $(call UV_INSTALL,,$(1)) || $(call UV_INSTALL,--system-certs,$(1)) || $(PIP_INSTALL) $(1)
SLIM = .venv/bin/python toolchain/slim.py .venv
WITH_ENV := source ./env.bash &&
# CMake's own make must not take part in the jobs of this one.
COLCON_BUILD := unset MAKEFLAGS MFLAGS && source toolchain/ros_env.bash && colcon build --symlink-install --packages-select

# Kernels compile while messages build.
MAKEFLAGS += --jobs=2

##@ Use
.PHONY: setup
setup: install/.package .venv/.extras install/.kernels ## Install ROS 2 Jazzy and the Python packages into .venv and build (the default)
	@echo "Ready: 'make run' drills, 'source env.bash' puts rpud into this shell, 'make help' lists the rest."

.PHONY: run
run: install/.package install/.kernels ## Drill in real time for DURATION seconds (10) and record to BAG (bags/<time>)
	@$(WITH_ENV) rpud run --duration $(DURATION) --record $(BAG)

.PHONY: precompile
precompile: install/.kernels ## Compile the model's kernels, so that no start has to

.PHONY: picture
picture: install/.package install/.kernels .venv/.browser ## Make docs/images again: drawings, and pages of runs made for it in Chromium
	@$(WITH_ENV) python -m toolchain.pictures docs/images

##@ Develop
.PHONY: test
test: install/.package .venv/.rest install/.kernels ## Run the tests of every change, with real nodes over DDS; PYTEST_ARGS passes on options
	@$(WITH_ENV) python -m pytest -n auto --dist worksteal $(PYTEST_ARGS)

# An empty mark selects the extended tests as well.
EXTENDED = RPUD_OPTIONAL="$$PWD/.venv/optional" python -m pytest -m "" --hypothesis-seed=$(SEED)
TWO_EACH = $$((2 * $$(nproc)))

.PHONY: test-all
test-all: SEED = $(shell echo $$RANDOM)
test-all: install/.package install/.kernels .venv/.browser .venv/.optional ## Run every test, also documents, browser, wheels and cluster; properties draw new examples from SEED
	@echo "Properties draw their examples from SEED=$(SEED)"
	@$(WITH_ENV) export RPUD_EXAMPLES=many; $(EXTENDED) -n auto --dist worksteal $(PYTEST_ARGS)

.PHONY: test-long
test-long: PARTS = soak test-busy starts campaign kills fuzz mutants random-sets
test-long: ## Run what takes hours, or those of PARTS: each to its end, then their results and times
	@failed=0; for part in $(PARTS); do began=$$SECONDS result=passed; \
	  $(MAKE) --no-print-directory $$part || { result=failed; failed=1; }; \
	  results+="$$(printf '%-12s %s in %d s' $$part $$result $$((SECONDS - began)))"$$'\n'; \
	done; printf '%s' "$$results"; exit $$failed

.PHONY: test-busy
test-busy: SEED = 0
test-busy: install/.package install/.kernels .venv/.browser .venv/.optional ## Run every test, two at a time for each processor and beside a busy loop: none may need an idle machine
	@$(WITH_ENV) python tools/busy.py -- env $(EXTENDED) -n $(TWO_EACH) --dist worksteal $(PYTEST_ARGS)

.PHONY: mutants
mutants: install/.package .venv/.rest install/.kernels ## Break the engine and the examples' supervisor in known ways: tests must find each
	@$(WITH_ENV) python -m pytest -m "" test/model/test_mutations.py && python examples/mutants.py

.PHONY: lint
lint: install/.package .venv/.lint .venv/.typescript ## Check style, types, the rules of import and package.xml
	@$(WITH_ENV) toolchain/lint.sh

.PHONY: format
format: .venv/.lint ## Format the code and mend what ruff can
	@.venv/bin/ruff format
	@.venv/bin/ruff check --fix

.PHONY: docs
docs: install/.package .venv/.rest .venv/.docs ## Publish docs/ as pages in build/docs; a warning or a broken link fails
	@$(WITH_ENV) export PYTHONPATH="$$PWD/.venv/docs:$$PYTHONPATH" && \
	  python -m sphinx --builder html --jobs auto --fresh-env --fail-on-warning --keep-going --quiet docs build/docs
	@echo "Pages: build/docs/index.html"

.PHONY: reference
reference: install/.package .venv/.rest ## Write the tables of docs/reference that follow from the code and the messages
	@$(WITH_ENV) python -m toolchain.reference

.PHONY: dist
dist: install/.package .venv/.rest ## Build wheels of both packages into dist/, for each CPython found or for PYTHONS
	@$(WITH_ENV) python -m toolchain.dist $(PYTHONS:%=--python %)

.PHONY: release
release: install/.package .venv/.rest install/.kernels ## Make and check all files of a release in build/release: wheels, sources, ROS packages; publish nothing
	@$(WITH_ENV) python -m toolchain.release

.PHONY: bench
bench: install/.package .venv/.extras install/.kernels ## Run the benchmarks, or those of BENCH_ARGS
	@$(WITH_ENV) python -m bench $(BENCH_ARGS)

.PHONY: validation
validation: install/.package .venv/.rest install/.kernels ## Run the paper's numbers and write docs/explanation/validation.md
	@$(WITH_ENV) python -m validation

.PHONY: measure-setup
measure-setup: ## Clone into a new folder and print the time of each stage from there to the first impact
	@toolchain/measure_setup.sh

.PHONY: campaign
campaign: install/.package .venv/.rest ## Fly one run of config/campaign.yaml RUNS times (100) beside busy loops; two different results fail
	@$(WITH_ENV) RPUD_REPETITIONS=$(RUNS) python tools/busy.py -- python -m pytest -m "" test/testing/campaign/test_repeat.py

.PHONY: starts
starts: install/.package .venv/.rest install/.kernels ## Start a node under test STARTS times (500), in three ways, beside busy loops: no first command is lost
	@$(WITH_ENV) RPUD_STARTS=$(STARTS) python tools/busy.py -- python -m pytest -m "" -n $(TWO_EACH) test/testing/test_starts.py

.PHONY: kills
kills: install/.package .venv/.rest ## Kill KILLS recordings (1000) at random moments, and recover each
	@$(WITH_ENV) python -m tools.kills --count $(KILLS) & writers=$$! live=; \
	$(WITH_ENV) python -m tools.kills --count $(KILLS) --max-loss 1 --live || live=failed; wait $$writers && test -z "$$live"

.PHONY: soak
soak: DURATION = 1800
soak: install/.package .venv/.rest ## Drill for DURATION seconds (1800) under a listener that checks memory, timing and counters
	@$(WITH_ENV) python -m bench soak --seconds $(DURATION)

.PHONY: fuzz
fuzz: N = 100000
fuzz: BAGS = 20000
fuzz: SEED = 0
fuzz: install/.package .venv/.extras ## Send N hostile inputs (100000) to every way into the drill, and read BAGS hostile bags (20000)
	@$(WITH_ENV) python -m tools.fuzz --inputs $(N) --bags $(BAGS) --seed $(SEED)

.PHONY: signatures
signatures: install/.package .venv/.rest ## Print the table of fault signatures
	@$(WITH_ENV) python test/helpers/fault_signatures.py

.PHONY: random-sets
random-sets: SETS = 400
random-sets: SEED = 0
random-sets: install/.package .venv/.rest ## Simulate SETS random parameter sets (400) over the whole ranges: none may hang
	@$(WITH_ENV) RPUD_SETS=$(SETS) RPUD_SEED=$(SEED) python -m pytest -m "" -n auto test/model/test_random_sets.py

.PHONY: lock
lock: ## Resolve the newest versions of toolchain/requirements/*.in into the lock files (needs uv)
	toolchain/lock.sh

.PHONY: clean
clean: ## Remove what was built
	rm -rf build dist install log rpud_sim/kernels/compiled .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis

.PHONY: distclean
distclean: clean ## Remove the virtual environment as well
	rm -rf .venv

.PHONY: help
help: ## Show this help
	@awk 'BEGIN { FS = ":.*## " } /^##@/ { printf "\n%s\n", substr($$0, 5) } \
	  /^[a-z-]+:.*## / { printf "  make %-11s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

# Set-up leaves stamps, so that it happens once for each state of the files that it depends on. Python sources are
# not among them: colcon links to them.
.venv/.installed: toolchain/requirements/installer.lock $(LOCK)
	@python="$$(ROS_PREFIX='$(ROS_PREFIX)' toolchain/find_python.sh)"; \
	echo "Installing $(if $(ROS_PREFIX),Python packages beside $(ROS_PREFIX),ROS 2 Jazzy) into .venv ..."; \
	"$$python" -m venv --clear $(if $(ROS_PREFIX),--system-site-packages) .venv
	@$(PIP_INSTALL) --only-binary :all: -r $<
	@$(call INSTALL,--no-build-isolation -r $(LOCK))
	@$(SLIM)
	@# colcon looks for ROS in folders with such files, and warns where they are missing.
	@$(if $(ROS_PREFIX),echo '$(ROS_PREFIX)' > .venv/ros_prefix,touch .venv/local_setup.{sh,bash,zsh})
	@touch $@

# What tests, sweeps and comparisons need, and a drill does not.
.venv/.rest: $(REST) .venv/.installed
	@echo "Installing packages of tests and sweeps into .venv ..."
	@$(call INSTALL,--only-binary :all: -r $<)
	@$(SLIM)
	@touch $@

# What exports and pictures need: a quarter of all, so that `make test` does without. Only extended tests use it.
.venv/.extras: $(EXTRAS) .venv/.rest
	@echo "Installing packages of exports and pictures into .venv ..."
	@$(call INSTALL,--only-binary :all: -r $<)
	@$(SLIM)
	@touch $@

.venv/.lint: toolchain/requirements/lint.lock .venv/.extras
	@$(call INSTALL,--only-binary :all: -r $<)
	@touch $@

# The type checker of the page's code. Without npm there is none, and lint says so.
.venv/.typescript: toolchain/typescript/package-lock.json .venv/.installed
	@if command -v npm > /dev/null; then mkdir -p .venv/typescript && cp toolchain/typescript/package*.json .venv/typescript && \
	  npm ci --prefix .venv/typescript --ignore-scripts --no-audit --no-fund --silent && touch $@; fi

.venv/.browser: toolchain/requirements/browser.lock .venv/.extras
	@$(call INSTALL,--only-binary :all: -r $<)
	@touch $@

# In a folder of its own, as docs.in says why.
.venv/.docs: toolchain/requirements/docs.lock .venv/.installed
	@rm -rf .venv/docs
	@$(call INSTALL,--only-binary :all: --target .venv/docs -r $<)
	@touch $@

# In a folder of its own, as optional.in says.
.venv/.optional: toolchain/requirements/optional.lock .venv/.installed
	@rm -rf .venv/optional
	@$(call INSTALL,--only-binary :all: --target .venv/optional -r $<)
	@touch $@

install/.messages: .venv/.installed $(wildcard toolchain/*.cmake msg_defs/*.* msg_defs/*/*.*)
	@echo "Building the messages ..."
	@rm -rf build/rpud_msgs install/rpud_msgs # else messages that were removed stay
	@export PYTHONPATH="$$PWD/toolchain/parse_once$${PYTHONPATH:+:$$PYTHONPATH}" && $(COLCON_BUILD) rpud_msgs
	@touch $@

# What is up to date already is found and left. A kernel comes from the sources of the model, and from those that call it.
install/.kernels: .venv/.installed $(wildcard rpud_sim/kernels/*.py rpud_sim/model/*.py) rpud_sim/simulation/sampling.py
	@mkdir -p install
	@echo "Compiling the model ..."
	@PYTHONPATH="$$PWD" .venv/bin/python -m toolchain.precompile
	@touch $@

install/.package: install/.messages package.xml setup.py setup.cfg $(wildcard launch/*.launch.py config/* urdf/*)
	@echo "Building the package ..."
	@find build install -xtype l -delete 2> /dev/null || true # else files that were removed stay, and fail
	@$(COLCON_BUILD) rpud_sim
	@touch $@
