# Every target sets up what it needs, on a machine that has Python 3.11 and nothing else.
#
#   make run                       a simulated swarm, until Ctrl-C
#   make run SECONDS=20            ... for 20 seconds
#   make run SCENARIO=swarm20      ... with 20 robots
#   make flash                     the board's firmware, built and uploaded
#   make flash PORT=/dev/ttyACM0   ... to the board at this port
#   make test                      every test
#   make lint                      ruff and mypy
#   make bench                     speed beside other software
#   make figures                   every table and picture of README.md and docs/, measured again
#   make figures ONLY=evaluation   ... only this table's results (SWARMLOC_DATA=FOLDER for recorded data)
#   make mutants                   do tests notice small changes to a sample of functions?
#   make test-lowest               every test, with the oldest dependencies allowed
#
# PYTHON=/path/to/python chooses the interpreter, VENV=/path/to/folder where its packages go.

SCENARIO ?= arena4
VENV ?= .venv
BIN := $(VENV)/bin
# Two at a time, a file each: tests of live runs would get into each other's way on more.
PYTEST := -m pytest -q -n 2 --dist loadfile

# On so few cores, and with arrays so small, the linear algebra's threads only get in each other's way.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1

.PHONY: run flash test lint bench figures mutants test-lowest clean

run: $(VENV)/ready-run
	$(BIN)/swarmloc run --simulate $(SCENARIO) $(if $(SECONDS),--seconds $(SECONDS))

flash: $(VENV)/ready-firmware
	$(BIN)/swarmloc flash $(if $(PORT),--port $(PORT))

test: $(VENV)/ready-test
	$(BIN)/python $(PYTEST)

lint: $(VENV)/ready-dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check host swarmloc tests tools
	$(BIN)/mypy

bench: $(VENV)/ready-bench
	@set -e; for bench in tools/bench/*.py; do echo "== $$bench"; \
	  $(BIN)/python -m "$$(echo $${bench%.py} | tr / .)"; done

figures: $(VENV)/ready-test
	$(BIN)/python -m tools.renew_figures $(if $(ONLY),--only $(ONLY)) $(if $(FILTERS),--filters $(FILTERS))

mutants: .venv/ready-test
	$(BIN)/python tools/mutants.py

test-lowest: .venv-lowest/ready-test
	.venv-lowest/bin/python $(PYTEST)

$(VENV)/ready-run: pyproject.toml tools/setup
	@PYTHON="$(PYTHON)" tools/setup $(VENV)

$(VENV)/ready-%: pyproject.toml tools/setup
	@PYTHON="$(PYTHON)" tools/setup $(VENV) $*

.venv-lowest/ready-%: pyproject.toml tools/setup tools/lowest-versions.txt
	@PYTHON="$(PYTHON)" tools/setup .venv-lowest $* tools/lowest-versions.txt

clean:
	rm -rf .venv .venv-lowest .mypy_cache .ruff_cache .pytest_cache .hypothesis
