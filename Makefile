# make demo runs on a machine with make and Python >= 3.11 alone; every other target sets up what it needs.

CANDIDATES := python3.13 python3.12 python3.11 python3
USABLE     := import ensurepip, sys, venv; sys.exit(sys.version_info < (3, 11))
PYTHON     ?= $(shell for p in $(CANDIDATES); do $$p -c '$(USABLE)' >/dev/null 2>&1 && { echo $$p; break; }; done)

VENV    := .venv
ALL     := .venv-all
PIP     := -m pip -qq --disable-pip-version-check

# What the demo needs comes from PyPI alone. The other plugins are installed beside it as declarations, without
# their libraries, for the checks. Tests with DOLFINx run in an environment of the system's own Python.
DEMO    := plugins/dacore-skfem plugins/dacore-biot plugins/dacore-imaging
OTHERS  := $(filter-out $(DEMO),$(patsubst %/pyproject.toml,%,$(wildcard plugins/*/pyproject.toml)))
editable = $(foreach folder,$(1),-e ./$(folder))
pyprojects = $(patsubst %,%/pyproject.toml,$(1))
SYSTEM_PYTHON ?= /usr/bin/python3
MFEM    := mfem==4.10.0.1

REQUIRE ?= skfem,dolfinx,mfem
WORKERS ?= 2
TESTED  := $(if $(filter-out skfem,$(REQUIRE)),$(ALL),$(VENV))
PYTEST   = DACORE_REQUIRE=$(REQUIRE) $(TESTED)/bin/python -m pytest

# Only what an environment holds counts, not what happens to lie elsewhere on this machine.
export PYTHONNOUSERSITE := 1
unexport PYTHONPATH PYTHONHOME PETSC_DIR

.DEFAULT_GOAL := help
.PHONY: help demo paper studies studies-33k test slow verify bench check docs clean
.DELETE_ON_ERROR:

# Test processes already share the cores; threads of BLAS in each would only fight over them.
test slow verify bench: export OMP_NUM_THREADS := 1
test slow verify bench: export OPENBLAS_NUM_THREADS := 1
test slow verify bench: export MKL_NUM_THREADS := 1

help: ## show this list
	@sed -n 's/^\([a-z0-9-]*\):.*## \(.*\)/make \1|\2/p' Makefile | awk -F'|' '{ printf "%-12s %s\n", $$1, $$2 }'

demo: $(VENV)/.demo ## reconstruct the state of the brain from a few measurements: results in runs/demo
	$(VENV)/bin/dacore run examples/brain/demo.toml --out runs/demo

paper: $(VENV)/.demo ## the published training set on 33k nodes by a reduced model: results in runs/paper
	$(VENV)/bin/python examples/brain/paper.py --out runs/paper

studies: $(VENV)/.demo ## every study of the paper and more, on the brain of 5k nodes: results in runs/studies
	$(VENV)/bin/dacore run examples/brain/studies.toml --out runs/studies

# On the fine mesh a truth of a finer mesh or of another order would take hours: the truths here are of its own size.
FINE := --set domain.nodes=33k --set 'study.mismatch.truths=[\
	{label = "neck moves by 1e-4 cm", set = {"physics.neck_displacement" = 1e-4}}, \
	{label = "steps divided by 4", set = {"time.substeps" = 4}}, \
	{label = "mesh of 5k nodes", set = {"domain.nodes" = "5k"}}]'

studies-33k: $(VENV)/.demo ## the same studies on the brain of 33k nodes: results in runs/studies-33k, an hour and more
	$(VENV)/bin/dacore run examples/brain/studies.toml $(FINE) --out runs/studies-33k

test: $(TESTED)/.dev ## run every test but the longer studies, on all three backends
	$(PYTEST) -n $(WORKERS)

slow: $(TESTED)/.dev ## run the longer studies
	$(PYTEST) -m slow

verify: $(TESTED)/.dev ## compare the forward model with solutions by formula; writes docs/verification.md and its figures
	$(PYTEST) tests/verification tests/convergence -m '' -n $(WORKERS)
	$(TESTED)/bin/python -m tests.verification

bench: $(TESTED)/.dev ## measure run times (tests/benchmarks/bench_*.py)
	$(PYTEST) tests/benchmarks -o python_files='bench_*.py' -m '' -q -s

check: $(VENV)/.dev ## lint, format, types, and imports that point down
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy
	$(VENV)/bin/lint-imports

docs: $(ALL)/.docs ## build the site, tutorials executed, warnings are errors: docs/_build/html
	@cd docs && ../$(ALL)/bin/python -m sphinx -b html -d _build/doctrees -j $(WORKERS) -q -n -W --keep-going . _build/html
	@$(ALL)/bin/python docs/_ext/look.py docs/_build/html
	@echo "Open docs/_build/html/index.html"

clean: ## remove the virtual environments, caches and the demo's results
	rm -rf $(VENV) $(ALL) runs/demo docs/_build docs/gallery docs/reference/api .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# A stamp is written last, so that whatever was cut short is done again. An environment that works is kept:
# a half-made one, or one whose Python is gone, is made anew.
$(VENV)/.demo: pyproject.toml $(call pyprojects,$(DEMO))
	@$(VENV)/bin/python -m pip --version >/dev/null 2>&1 || $(MAKE) --no-print-directory .venv-made
	@echo "Installing dacore and its plugins into $(VENV) (a minute or two the first time)"
	@$(VENV)/bin/python $(PIP) install -e '.[figures]' $(call editable,$(DEMO))
	@touch $@

$(VENV)/.dev: $(VENV)/.demo $(call pyprojects,$(OTHERS))
	@echo "Installing the tools for tests and checks into $(VENV)"
	@$(VENV)/bin/python $(PIP) install -e '.[figures,test,dev]' $(call editable,$(DEMO))
	@$(if $(OTHERS),$(VENV)/bin/python $(PIP) install --no-deps $(call editable,$(OTHERS)))
	@touch $@

# The system's DOLFINx runs on the numpy it was compiled for: not on numpy 2 if the system's own is older. MFEM's
# metadata asks for a newer numpy and for numba; it runs without, so its dependencies are left out.
$(ALL)/.dev: pyproject.toml $(call pyprojects,$(DEMO) $(OTHERS)) tests/environment/check.py Makefile
	@sh tests/environment/system.sh $(SYSTEM_PYTHON)
	@$(ALL)/bin/python -c '$(SOUND)' >/dev/null 2>&1 || { \
	    echo "Making $(ALL) with $$($(SYSTEM_PYTHON) --version), DOLFINx included"; \
	    $(SYSTEM_PYTHON) -m venv --system-site-packages --clear $(ALL); }
	@echo "Installing dacore, all its plugins and the tools for tests into $(ALL) (a minute or two the first time)"
	@numpy=$$($(SYSTEM_PYTHON) -I -c 'import numpy; print("numpy<2" if numpy.__version__[:2] == "1." else "numpy")') && \
	$(ALL)/bin/python $(PIP) install "$$numpy" -e '.[figures,test,dev]' $(call editable,$(DEMO))
	@$(ALL)/bin/python $(PIP) install --no-deps $(MFEM) $(call editable,$(OTHERS))
	@$(ALL)/bin/python tests/environment/check.py
	@touch $@

$(ALL)/.docs: $(ALL)/.dev
	@echo "Installing the tools for the site into $(ALL)"
	@numpy=$$($(ALL)/bin/python -c 'import numpy; print("numpy==" + numpy.__version__)') && \
	$(ALL)/bin/python $(PIP) install "$$numpy" -e '.[docs]'
	@touch $@

# Its own pip is there, for this very version of Python, and DOLFINx can be imported.
SOUND := import sys, pip, dolfinx; sys.exit(not pip.__file__.startswith(sys.prefix))

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
