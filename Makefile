# Everything needed day to day; `make help` lists the targets.
# Settings, on the command line or in the environment:
#   PYTHON    the Python (3.11 or newer) that makes the environment      make demo PYTHON=python3.12
#   VENV      where the environment lives                                make test VENV=~/venvs/acp_lab
#   PIP_ARGS  extra arguments of every pip install, e.g. another index   make demo PIP_ARGS="--extra-index-url ..."
#   OUT       where the demo writes                                      make demo OUT=~/demo
#   DATASETS  what to measure on                                         make bench DATASETS="path/to/bop other/set"
#   SECONDS   how long to look for files that break a reader             make fuzz SECONDS=60

PYTHON   ?= python3
VENV     ?= .venv
PIP_ARGS ?=
OUT      ?= acp_lab_demo
DATASETS ?= acp_lab/sample/data
SECONDS  ?= 600

# The networks here are so small that more threads only wait for each other (environment.md, Threads).
OMP_NUM_THREADS ?= 1
export OMP_NUM_THREADS

BIN := $(VENV)/bin
# Stamps: pip runs again only when pyproject.toml is newer than the last install, so that everything works offline.
RUN_STAMP := $(VENV)/.installed-run
DEV_STAMP := $(VENV)/.installed-dev
FUZZ_STAMP := $(VENV)/.installed-fuzz
BOOK_STAMP := $(VENV)/.installed-book

.DEFAULT_GOAL := help
.PHONY: help install install-dev demo test test-fast faults faults-long fuzz lint types format lab wheel pictures book bench clean clean-all
.DELETE_ON_ERROR:

help: ## list all targets
	@awk 'BEGIN { FS = ":.*## " } /^[a-z-]+:.*## / { printf "  %-12s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

demo: $(RUN_STAMP) ## prepare the sample part, track the sample sequence, print accuracy and speed
	"$(BIN)/acp-lab" demo --out "$(OUT)"

test: lint types ## everything that CI runs: lint, types, all tests
	"$(BIN)/python" -m pytest

test-fast: $(DEV_STAMP) ## the tests that take under 3 minutes together
	"$(BIN)/python" -m pytest -m "not slow and not browser"

faults: $(DEV_STAMP) ## what happens when something goes wrong: try it all, write docs/faults.md
	"$(BIN)/python" -m tests.faults --write

faults-long: $(DEV_STAMP) fuzz ## the same for random moments, long runs and random files; hours
	"$(BIN)/python" -m tests.faults --long

fuzz: $(FUZZ_STAMP) ## random files for every reader, SECONDS in all (default 600)
	"$(BIN)/python" -m tests.fuzz --seconds "$(SECONDS)"

lint: $(DEV_STAMP) ## ruff
	"$(BIN)/python" -m ruff check .

types: $(DEV_STAMP) ## mypy
	"$(BIN)/python" -m mypy

format: $(DEV_STAMP) ## sort imports and fix what ruff can fix
	"$(BIN)/python" -m ruff check --fix .

lab: $(DEV_STAMP) ## open JupyterLab on the notebooks
	"$(BIN)/acp-lab" lab

wheel: $(DEV_STAMP) ## build dist/acp_lab-*.whl, sample included
	rm -rf build
	"$(BIN)/python" -m build --wheel --outdir dist .

pictures: $(DEV_STAMP) ## renew the moving picture of the README and the screenshots in docs/images; needs Chromium
	"$(BIN)/python" -m benchmarks.moving_picture --parts "$(OUT)/parts"
	"$(BIN)/python" -m tests.browser.pictures "$(OUT)/parts"

book: $(BOOK_STAMP) ## build the site: course with outputs, documents, reference; in book/_build/html
	"$(BIN)/python" -m sphinx -b html -c book -d book/_build/doctrees . book/_build/html
	"$(BIN)/python" book/links.py book/_build/html

bench: $(DEV_STAMP) ## accuracy and speed on DATASETS (default: the sample), see benchmarks/
	"$(BIN)/python" -m benchmarks.tracking $(DATASETS) --parts "$(OUT)/bench_parts"

install: $(RUN_STAMP) ## make the environment, to use acp_lab

install-dev: $(DEV_STAMP) ## make the environment, to work on acp_lab

clean: ## remove what tests, builds and the demo left behind; keeps the environment
	rm -rf build dist book/_build book/_generated *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis acp_lab_demo notebooks/course_files
	find . -name __pycache__ -type d -not -path './$(VENV)/*' -prune -exec rm -rf {} +

clean-all: clean ## remove the environment too
	rm -rf "$(VENV)"

$(BIN)/python:
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "error: $(PYTHON) is missing or older than 3.11; name another one: make PYTHON=python3.12"; exit 1; }
	@"$(PYTHON)" -m venv "$(VENV)" || \
	  { echo "error: $(PYTHON) cannot make virtual environments; on Debian and Ubuntu: apt-get install python3-venv"; exit 1; }

# The rerun viewer asks about usage statistics at its first start, which can hang without a network.
define quiet_rerun
	@"$(BIN)/rerun" analytics disable >/dev/null 2>&1 </dev/null || true
endef

$(RUN_STAMP): pyproject.toml | $(BIN)/python
	"$(BIN)/python" -m pip install $(PIP_ARGS) -e .
	$(quiet_rerun)
	@touch "$@"

$(DEV_STAMP): pyproject.toml | $(BIN)/python
	"$(BIN)/python" -m pip install $(PIP_ARGS) -e ".[dev,step,recipes,notebook]"
	$(quiet_rerun)
	@touch "$(RUN_STAMP)" "$@"

# A fuzzer that follows coverage, where there is one for this system; without it random files come from hypothesis.
$(FUZZ_STAMP): $(DEV_STAMP)
	"$(BIN)/python" -m pip install $(PIP_ARGS) -e ".[fuzz]" || echo "note: no atheris here, hypothesis draws the files"
	@touch "$@"

$(BOOK_STAMP): pyproject.toml | $(DEV_STAMP)
	"$(BIN)/python" -m pip install $(PIP_ARGS) -e ".[book]"
	@touch "$@"
