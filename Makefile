# make demo runs on a machine with make and Python >= 3.11 alone; every other target sets up what it needs.

CANDIDATES := python3.13 python3.12 python3.11 python3
USABLE     := import ensurepip, sys, venv; sys.exit(sys.version_info < (3, 11))
PYTHON     ?= $(shell for p in $(CANDIDATES); do $$p -c '$(USABLE)' >/dev/null 2>&1 && { echo $$p; break; }; done)

VENV    := .venv
BIN     := $(VENV)/bin
PIP     := $(BIN)/python -m pip -qq --disable-pip-version-check
PROJECT := pyproject.toml plugins/dacore-skfem/pyproject.toml plugins/dacore-biot/pyproject.toml \
           plugins/dacore-imaging/pyproject.toml
PLUGINS := $(foreach file,$(filter plugins/%,$(PROJECT)),-e $(patsubst %/pyproject.toml,./%,$(file)))

REQUIRE ?= skfem
WORKERS ?= 2
PYTEST   = DACORE_REQUIRE=$(REQUIRE) $(BIN)/python -m pytest

.DEFAULT_GOAL := help
.PHONY: help demo test slow bench check clean
.DELETE_ON_ERROR:

# Test processes already share the cores; threads of BLAS in each would only fight over them.
test slow bench: export OMP_NUM_THREADS := 1
test slow bench: export OPENBLAS_NUM_THREADS := 1
test slow bench: export MKL_NUM_THREADS := 1

help: ## show this list
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/make \1|\2/p' Makefile | awk -F'|' '{ printf "%-12s %s\n", $$1, $$2 }'

demo: $(VENV)/.demo ## reconstruct the state of the brain from a few measurements: results in runs/demo
	$(BIN)/dacore run examples/brain/demo.toml --out runs/demo

test: $(VENV)/.dev ## run every test but the longer studies
	$(PYTEST) -n $(WORKERS) -q

slow: $(VENV)/.dev ## run the longer studies
	$(PYTEST) -m slow

bench: $(VENV)/.dev ## measure run times (tests/benchmarks/bench_*.py)
	$(PYTEST) tests/benchmarks -o python_files='bench_*.py' -m '' -q -s

check: $(VENV)/.dev ## lint, format, types, and imports that point down
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

clean: ## remove the virtual environment, caches and the demo's results
	rm -rf $(VENV) runs/demo .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# A stamp is written last, so that whatever was cut short is done again. An environment that works is kept:
# a half-made one, or one whose Python is gone, is made anew.
$(VENV)/.demo: $(PROJECT)
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(MAKE) --no-print-directory .venv-made
	@echo "Installing dacore and its plugins into $(VENV) (a minute or two the first time)"
	@$(PIP) install -e '.[figures]' $(PLUGINS)
	@touch $@

$(VENV)/.dev: $(VENV)/.demo
	@echo "Installing the tools for tests and checks into $(VENV)"
	@$(PIP) install -e '.[figures,test,dev]' $(PLUGINS)
	@touch $@

.PHONY: .venv-made
.venv-made:
	@python='$(PYTHON)'; \
	if [ -z "$$python" ]; then \
	    for p in $(CANDIDATES); do \
	        if $$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then \
	            echo "$$p cannot make virtual environments: its venv module is missing." >&2; \
	            echo "On Debian or Ubuntu: sudo apt install python3-venv; then run make again." >&2; \
	            exit 1; \
	        fi; \
	    done; \
	    echo "No Python >= 3.11 among: $(CANDIDATES)." >&2; \
	    echo "Install one (Debian 12 and Ubuntu 24.04 have it: sudo apt install python3 python3-venv)," >&2; \
	    echo "or say where it is: make PYTHON=/path/to/python3" >&2; \
	    exit 1; \
	fi; \
	if ! "$$python" -c 'import sys' >/dev/null 2>&1; then \
	    echo "PYTHON=$$python cannot be run; give a Python >= 3.11: make PYTHON=/path/to/python3" >&2; exit 1; \
	fi; \
	"$$python" -c 'import sys; v = sys.version_info; v >= (3, 11) or sys.exit("PYTHON=%s is Python %d.%d; dacore needs 3.11 or newer: make PYTHON=/path/to/python3" % (sys.executable, v[0], v[1]))' || exit 1; \
	if ! "$$python" -c 'import ensurepip, venv' >/dev/null 2>&1; then \
	    echo "PYTHON=$$python has no venv module; on Debian or Ubuntu: sudo apt install python3-venv" >&2; exit 1; \
	fi; \
	echo "Making $(VENV) with $$("$$python" --version)"; \
	"$$python" -m venv --clear $(VENV)
