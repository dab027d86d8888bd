# `make` lists the targets. `make run` and `make test` create the environment first.
.DEFAULT_GOAL := help

SCENARIO ?= scenarios/indoor_lab.yaml
DURATION ?=
# How often a failed test is repeated before it counts as failed.
RERUNS ?= 0
REPORT ?=

BIN := .venv/bin
# Tests start hundreds of processes: none compiles again what another has compiled.
PYTEST := PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest
# Tests wait now and then: one more of them than there are processors.
WORKERS := $(shell echo $$(($$(nproc) + 1)))
READY := .venv/.ready
READY_RUN := .venv/.ready-run
SETUP_INPUTS := pyproject.toml udp-bridge/pyproject.toml setup.sh \
	$(wildcard services/*/*/*.c services/*/*/*/*.c udp-bridge/src/udp_bridge/io/native/*.[ch] ros/*/msg/*.msg ros/ros2/*.py ros/ros2/*/setup.py)
# Programs of the experiments that tests need.
PROGRAMS := yag-slam kiss-icp evo
# Files with tests marked `system`; collecting all others takes longer than many of these tests.
SYSTEM_TESTS := tests/system tests/ros1 tests/ros/cpp tests/bridge/test_kernel_loss.py \
	tests/docs/test_tutorials.py

.PHONY: help setup run test test-units test-system test-alone test-stack test-nightly environments mutants fuzz nightly benchmarks experiments docs clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | awk -F ':.*## ' '{ printf "  %-14s %s\n", $$1, $$2 }'

setup: $(READY) ## create the environment for development in .venv

$(READY): $(SETUP_INPUTS)
	@./setup.sh

$(READY_RUN): $(SETUP_INPUTS)
	@./setup.sh $(if $(wildcard $(READY)),development,run)

run: $(READY_RUN) ## run SCENARIO and show what arrives in ROS; DURATION=20 stops after 20 s, REPORT=FILE.json writes a report
	@$(BIN)/groundlink up $(SCENARIO) \
		$(if $(DURATION),--duration $(DURATION)) $(if $(REPORT),--report $(REPORT))

test: setup ## run all tests that need no Docker engine, in three stages; a failed stage does not stop the next
	@$(MAKE) --no-print-directory --keep-going test-units test-system test-alone

test-units: setup ## run unit tests, import contracts, style and type checks
	@$(PYTEST) -m "not system and not stack and not nightly" --reruns=$(RERUNS) --numprocesses=$(WORKERS) --dist=loadfile \
		--no-loadscope-reorder

environments: setup ## install third-party programs that tests of the experiments need
	@flock .venv/.environments $(BIN)/python -m experiments $(patsubst %,--install %,$(PROGRAMS))

test-system: environments ## run tests of the running system, three at a time
	@$(PYTEST) -m "system and not alone and not stack and not nightly" --reruns=$(RERUNS) --durations=20 \
		--numprocesses=3 --dist=loadfile --no-loadscope-reorder $(SYSTEM_TESTS)

test-alone: setup ## run tests that measure real-time rates, one at a time
	@$(PYTEST) -m "alone" --reruns=$(RERUNS) --durations=20 $(SYSTEM_TESTS)

test-stack: setup ## test the containers on a Docker engine
	@$(PYTEST) -m stack --reruns=$(RERUNS) -rPR --durations=5 tests/deploy

test-nightly: PROGRAMS += small-gicp genz-lio rko-lio
test-nightly: environments ## run tests that take long
	@$(PYTEST) -m nightly --reruns=$(RERUNS) --durations=20

benchmarks: setup ## run the benchmarks with claims; fail if a claim does not hold
	@$(BIN)/python -m benchmarks

mutants: setup ## mutation tests; fail if fewer than 97 % of the mutants are found
	@$(BIN)/python -m tests.mutants

nightly: setup ## run what takes too long for each change: long tests, mutants, fuzzers, benchmarks
	@$(MAKE) --no-print-directory --keep-going test-nightly mutants fuzz benchmarks

fuzz: setup ## run each fuzzer for a minute
	@$(BIN)/python -m fuzz.guided --seconds 60
	@$(BIN)/python -m fuzz.batches --seconds 60
	@$(BIN)/python -m fuzz.sequences --seconds 60

experiments: setup ## run the experiments of the paper with third-party SLAM programs (NAMES=..., SHORT=1)
	@$(BIN)/python -m experiments $(if $(SHORT),--short) $(NAMES)

docs: setup ## build the documentation site in site/; fail at a broken link, anchor or picture
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo "site/index.html"

clean: ## remove the environment and all caches
	@rm -rf .venv build site *.egg-info udp-bridge/src/*.egg-info \
		.mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
