# `make run` and `make test` are all one needs; both make the environment first.
SCENARIO ?= scenarios/indoor_lab.yaml
DURATION ?=
REPORT ?=

BIN := .venv/bin
READY := .venv/.ready
SOURCES_OF_SETUP := pyproject.toml udp-bridge/pyproject.toml setup.sh \
	$(wildcard services/sensors/*/*.c udp-bridge/src/udp_bridge/io/native/*.[ch] ros/*/msg/*.msg ros/ros2/*.py ros/ros2/*/setup.py)

.PHONY: help setup run test test-units test-system test-alone test-stack environments mutants fuzz nightly benchmarks experiments clean

help: ## show this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/'

setup: $(READY) ## make the environment in .venv and nothing else

$(READY): $(SOURCES_OF_SETUP)
	@./setup.sh

run: setup ## start SCENARIO and show what arrives in ROS (DURATION=20 ends by itself)
	@$(BIN)/groundlink up $(SCENARIO) \
		$(if $(DURATION),--duration $(DURATION)) $(if $(REPORT),--report $(REPORT))

test: setup ## run every test that needs no Docker engine; a failed stage does not keep the next from running
	@$(MAKE) --no-print-directory --keep-going test-units test-system test-alone

test-units: setup ## run what starts no whole run: units, architecture, style, types
	@$(BIN)/python -m pytest -m "not system and not stack" --numprocesses=auto --dist=loadfile

environments: setup ## install the programs of others that a test of the experiments uses
	@flock .venv/.environments $(BIN)/python -m experiments --install yag-slam --install evo

test-system: environments ## run the tests of the real system that may go on beside each other
	@$(BIN)/python -m pytest -m "system and not alone and not stack" --durations=20 \
		--numprocesses=2 --dist=loadfile

test-alone: setup ## run the tests that look at rates in real time, one by one
	@$(BIN)/python -m pytest -m "alone" --durations=20

test-stack: setup ## bring the containers up on a Docker engine, break them, look
	@$(BIN)/python -m pytest -m stack -rP --durations=5 tests/deploy

benchmarks: setup ## measure what the documents promise; fail where a promise does not hold
	@$(BIN)/python -m benchmarks

mutants: setup ## plant faults in the sources; fail where the tests find fewer than 97 % of them
	@$(BIN)/python -m tests.mutants

nightly: setup ## what takes too long for every change: mutants, fuzzers, benchmarks
	@$(MAKE) --no-print-directory --keep-going mutants fuzz benchmarks

fuzz: setup ## a minute of each fuzzer
	@$(BIN)/python -m fuzz.guided --seconds 60
	@$(BIN)/python -m fuzz.runs --seconds 60
	@$(BIN)/python -m fuzz.sequences --seconds 60

experiments: setup ## the paper's experiments, with SLAM programs of others (NAMES=..., SHORT=1)
	@$(BIN)/python -m experiments $(if $(SHORT),--short) $(NAMES)

clean: ## remove the environment and every cache
	@rm -rf .venv build *.egg-info udp-bridge/src/*.egg-info \
		.mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
