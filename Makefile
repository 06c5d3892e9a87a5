# Every target sets up its own .venv from uv.lock; the machine needs python3 (3.11 or newer) and make.

PYTHON ?= python3
BIN := .venv/bin
READY := .venv/ready

export UV_PROJECT_ENVIRONMENT := .venv
export UV_PYTHON_DOWNLOADS := never
export UV_SYSTEM_CERTS := 1

.PHONY: demo test test-slow lint docs bench panel clean

demo: $(READY)
	$(BIN)/twin balance cubesat --rrd runs/demo/cubesat.rrd
	$(BIN)/twin diagnose models/dfki_pendulum/logs/energy_shaping --report runs/demo/pendulum.html

# these fill the cores with processes
test test-slow panel: export OPENBLAS_NUM_THREADS := 1
# and each of them would compile anew all that it imports
test test-slow panel: export PYTHONDONTWRITEBYTECODE :=

# What takes longest is printed. A worker that has nothing left takes the last half of what another
# has: no file is waited for, and the tests of a file, with what they share, stay together but where
# the halves meet.
PYTEST := $(BIN)/pytest --dist worksteal --durations 15 --durations-min 2

# Tests that wait for the clock compute little, so many at a time, and nothing of ours beside them
# that does. Both parts run whatever the first says.
CLOCKED = $$(grep -rl --include='test_*.py' 'mark\.wall_clock' tests)

test: $(READY)
	@status=0; \
	$(PYTEST) -n 6 -m "wall_clock and not slow" $(CLOCKED) || status=1; \
	$(PYTEST) -n 2 -m "not slow and not wall_clock" || status=1; \
	exit $$status

test-slow: $(READY)
	@status=0; \
	$(PYTEST) -n 6 -m "wall_clock and slow" $(CLOCKED) || status=1; \
	$(PYTEST) -n 2 -m "slow and not wall_clock" || status=1; \
	exit $$status

lint: $(READY)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright

# The site lies in runs/site; mkdocs and its plugins are of a group of their own.
docs: $(READY)
	$(BIN)/uv sync --quiet --frozen --group docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --config-file .ci/mkdocs.yml

bench: $(READY)
	$(BIN)/python -m benchmarks

panel: $(READY)
	$(BIN)/python tests/promises/panel.py --jobs 2

clean:
	rm -rf .venv .pytest_cache .ruff_cache build dist runs

$(READY): pyproject.toml uv.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "$(PYTHON) is missing or older than 3.11: install Python 3.11 or newer," \
	    "or name one: make PYTHON=python3.12" >&2; exit 1; }
	@test -x $(BIN)/pip || $(PYTHON) -m venv --clear .venv || { \
	  echo "$(PYTHON) cannot make a virtual environment:" \
	    "install its venv module (on Debian: apt-get install python3-venv)" >&2; exit 1; }
	$(BIN)/pip install --quiet "uv>=0.13,<0.14"
	$(BIN)/uv sync --quiet --frozen
	@touch $@
