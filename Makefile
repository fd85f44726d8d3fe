# Everything that a bare machine with python3 (3.10 or newer), pip and make needs to try and to test
# hmcvt; nothing is installed outside .venv.
#
#   make demo    watch a ROS 2 node serve the bench tests of the paper and refit itself; then a cause is
#                withheld and found, or not (make demo SEED=7 repeats one)
#   make test    all tests, the ones over ROS 2 included
#   make test-core  the tests of the core alone, offline: needs NumPy, SciPy, PyYAML and pytest
#   make test-long  further campaigns, studies and whole stories, a quarter of an hour more
#   make lint types    what CI checks besides
#   make format  lay out all code as `make lint` wants it
#   make oldest  the tests of core, diagnosis, units and commands on the oldest versions that
#                pyproject.toml allows, about those of the robot's own packages
#   make colcon  build and test the package as a ROS workspace does; in build/
#   make soak    the endurance trial of the node; writes docs/studies/soak.md (a quarter of an hour;
#                the machine should do nothing else meanwhile)
#   make reproduce  every number and figure of the paper beside ours; in reproduction/
#   make blind   the blind trial of the diagnosis; writes docs/studies/blind.md (two hours on two cores)
#   make benchmark  hmcvt and five simpler methods on the same cases; writes
#                docs/studies/benchmark.md (a quarter of an hour on two cores)
#   make real    a rig with known faults and makers' units, from data/real (or DIR=...); writes
#                docs/studies/real.md (two minutes)
#   make mutants  200 random mistakes in the core: do the tests see them? writes docs/studies/mutants.md
#   make export  exported C and FMU against Python, on every compiler of the machine; writes
#                docs/studies/export-check.md (a quarter to half an hour)
#   make docs    the pages of docs/ as a web site, in site/
#   make bench   time everything against what one would use instead; writes docs/studies/timings.md (ten
#                minutes; nothing else meanwhile, too)
#   make lock    write constraints.txt anew: the newest versions of all that is installed for tests
#   make clean   remove .venv and what tools left behind

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# setuptools warns at length that an editable installation is editable.
INSTALL := PYTHONWARNINGS=ignore $(BIN)/python -m pip --disable-pip-version-check install --quiet
# The tests and the demonstration run with these versions; `make lock` moves them.
LOCKED := $(INSTALL) --constraint constraints.txt

# The wheels of ROS bring their own libraries; those of a ROS installation that this shell has
# sourced, or of another environment with such wheels, must not be mixed in.
unexport PYTHONPATH LD_LIBRARY_PATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH RMW_IMPLEMENTATION
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE PYTHONHOME VIRTUAL_ENV
# The tests start hundreds of processes; with it each of them would compile hmcvt anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-core test-long lint types format oldest colcon soak bench benchmark coverage real blind reproduce mutants export docs lock system clean
.DELETE_ON_ERROR:

demo: $(VENV)/.ros
	@$(BIN)/python examples/demo.py
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m studies.withheld $(if $(SEED),--seed $(SEED))

# Nodes mostly wait: there may be more of them than cores. The endurance trial counts milliseconds and
# runs alone. The order is that of tests/conftest.py.
SHARED = --dist loadfile --no-loadscope-reorder --numprocesses
test: $(VENV)/.dev system
ifdef ARGS
	$(BIN)/python -m pytest $(ARGS)
else
	$(BIN)/python -m pytest -rs $(SHARED) auto -m 'not long' --ignore=tests/ros --ignore=tests/soak
ifneq ($(HMCVT_CORE_ONLY),1)
	$(BIN)/python -m pytest $(SHARED) $$((3 * $$(nproc))) -m 'not long' tests/ros
	$(BIN)/python -m pytest tests/soak
endif
endif

test-core: $(VENV)/.core
	$(BIN)/python -m pytest -m 'not long' tests/core

test-long: $(VENV)/.dev system
	$(BIN)/python -m pytest $(SHARED) auto -m long

# The pages are tested in a real browser, the SROS2 policy by a DDS that has security (the one in the
# ROS wheels has none); these two come from apt.
system:
	@missing=; \
	for name in chromium chromium-browser google-chrome; do \
		if command -v $$name >/dev/null; then found=1; fi; done; \
	test -n "$$found" || missing=chromium; \
	for name in idlc cc; do command -v $$name >/dev/null || \
		secure='cyclonedds-dev cyclonedds-tools gcc libc6-dev openssl'; done; \
	test -n "$$missing$$secure" || exit 0; \
	echo "Installing for the tests: $$missing $$secure ..."; \
	sudo=; test "$$(id -u)" = 0 || sudo=sudo; export DEBIAN_FRONTEND=noninteractive; \
	$$sudo apt-get update -qq; \
	test -z "$$missing" || \
		$$sudo apt-get install -y -qq chromium fonts-dejavu-core >/dev/null || \
		$$sudo apt-get install -y -qq chromium-browser fonts-dejavu-core >/dev/null || exit 1; \
	test -z "$$secure" || $$sudo apt-get install -y -qq $$secure >/dev/null || \
		echo "No Cyclone DDS to be had: the test of the SROS2 policy in force will be skipped."

# Goes on where it was interrupted; remove blind-results.jsonl to start anew.
blind: $(VENV)/.dev
	$(BIN)/python -m studies.blind --seed-base 900000000 --out docs/studies/blind.md
	$(BIN)/python -m studies.blind --plant bench --campaigns 120 --seed 97000000 \
		--page blind-bench.md
	cat blind-bench.md >> docs/studies/blind.md
	rm blind-bench.md

reproduce: $(VENV)/.dev
	$(BIN)/python -m studies.reproduce --out reproduction

soak: $(VENV)/.dev
	$(BIN)/python -m studies.soak --out docs/studies/soak.md

# A million points of made-up stages against an independent solver.
edges: $(VENV)/.dev
	$(BIN)/python -m studies.edges

# Tables of real rigs and units; data/README.md states their sources and licences.
real: $(VENV)/.dev
	$(BIN)/python -m studies.real $(DIR) --out docs/studies/real.md

# Coverage of the 95 % intervals, and changes against a sound state, on simulated machines.
coverage: $(VENV)/.dev
	$(BIN)/python -m studies.coverage
	$(BIN)/python -m studies.baseline

bench: $(VENV)/.dev
	$(BIN)/python -m studies.timing --out docs/studies/timings.md

# Goes on where it was interrupted; remove build/benchmark to start anew.
benchmark: $(VENV)/.dev
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m studies.benchmark --page docs/studies/benchmark.md

export: $(VENV)/.dev
	$(BIN)/python -m studies.export --out docs/studies/export-check.md

# Goes on where it was interrupted (build/mutants holds the results).
mutants: $(VENV)/.mutants
	$(BIN)/python -m studies.mutants --out docs/studies/mutants.md

docs: $(BIN)/python
	@$(LOCKED) --editable '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# For all Pythons from 3.10 on at once. Without setuptools: `make colcon` needs an old one.
lock: $(BIN)/python
	@$(INSTALL) uv
	$(BIN)/uv --quiet pip compile pyproject.toml --all-extras --universal --python-version 3.10 --upgrade \
		--no-emit-package setuptools --no-annotate --custom-compile-command 'make lock' \
		--output-file constraints.txt

lint: $(VENV)/.dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports --no-cache

types: $(VENV)/.dev
	$(BIN)/mypy

format: $(VENV)/.dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# Packages of the same time that these lean on: pyparsing of later years scolds matplotlib.
oldest: $(VENV)/.dev
	@$(INSTALL) uv
	$(BIN)/uv --quiet venv --clear build/oldest
	$(BIN)/uv --quiet pip install --python build/oldest/bin/python --resolution lowest-direct \
		--editable '.[report,table,test]' 'pyparsing==3.0.9' 'import-linter>=2.7'
	build/oldest/bin/python -m pytest $(SHARED) auto tests/core tests/diagnosis tests/units tests/cli

# The newest setuptools that `colcon build --symlink-install` works with.
COLCON = PATH=$(CURDIR)/$(BIN):$$PATH colcon --log-base build/log
PLACES = --base-paths . --build-base build/colcon
colcon: $(VENV)/.dev
	@$(INSTALL) 'setuptools<80' colcon-common-extensions
	$(COLCON) build $(PLACES) --install-base build/install
	$(COLCON) build $(PLACES)-linked --install-base build/linked --symlink-install
	$(COLCON) test $(PLACES) --install-base build/install --event-handlers console_direct+ \
		--pytest-args tests/test_packaging.py tests/ros/test_parameters.py \
		tests/ros/test_security.py tests/ros/test_node_serves.py
	$(COLCON) test-result --test-result-base build/colcon --verbose

clean:
	rm -rf $(VENV) build dist site *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Debian and Ubuntu leave ensurepip to the package python3-venv; pip can fill an environment that
# has none of its own.
$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || \
		{ echo "hmcvt needs Python 3.10 or newer; try: make PYTHON=python3.12 $(MAKECMDGOALS)"; \
		  exit 1; }
	@$(PYTHON) -m venv --without-pip $(VENV)
	@$(PYTHON) -m pip --python $(BIN)/python --disable-pip-version-check install --quiet pip

$(VENV)/.core: $(BIN)/python pyproject.toml setup.py constraints.txt
	@$(LOCKED) --editable '.[test-core]'
	@touch $@

$(VENV)/.ros: $(BIN)/python pyproject.toml setup.py constraints.txt
	@echo "Installing hmcvt and ROS 2 from wheels into $(VENV) (about 500 MB, once) ..."
	@$(LOCKED) --editable '.[ros,bag,report]'
	@touch $@

$(VENV)/.dev: $(VENV)/.ros
	@echo "Installing the tools for tests ..."
	@$(LOCKED) --editable '.[ros,report,bag,table,export,compare,fleet,docs,test,dev]'
	@touch $@

$(VENV)/.mutants: $(VENV)/.dev
	@$(LOCKED) --editable '.[mutants]'
	@touch $@
