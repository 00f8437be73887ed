# make demo    a field file, a picture and a table from the silicon plate in data/, in a few minutes on a fresh machine
# make test    lint and all tests, but for those that have environments of their own: learned models,
# make test-torch | test-mace | test-nequip    (the last two need different versions of one library), and
# make test-tools   ParaView's readers, OVITO, streams (IMDv3), OpenMM, dynasor, Euphonic and seekpath
# make docs    the site, in build/site: dead links are errors (its snippets are run by the tests)
# make lint    ruff, mypy         make bench   speed, to be read by a person          make clean   remove what make made
#
# Needs Python 3.11 or newer; everything else goes into .venv, which is made on first use.
# Another Python: make PYTHON=/path/to/python demo.  More test processes: make JOBS=8 test.

.PHONY: help demo test test-torch test-mace test-nequip test-tools docs lint bench clean
.DELETE_ON_ERROR:
.SUFFIXES:

VENV ?= .venv
VENV_TOOLS ?= .venv-tools
VENV_DOCS ?= .venv-docs
OUT ?= demo-out
JOBS ?= 2

ifndef PYTHON
PYTHON := $(shell for p in python3.13 python3.12 python3.11 python3; do \
    if command -v $$p >/dev/null 2>&1 && $$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; \
    then echo $$p; break; fi; done)
endif

BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
DATA := data/silicon_plate
SOURCES := $(shell find atc -name '*.py')

help:
	@sed -n 's/^# \{0,1\}//;1,10p' Makefile

# ---- the environment

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "make: no Python 3.11 or newer found (looked for python3.13, python3.12, python3.11, python3): install one, or say make PYTHON=/path/to/python" >&2; exit 1; }
	@echo "making $(VENV) with $(PYTHON)"
	@"$(PYTHON)" -m venv "$(VENV)" || { rm -rf "$(VENV)"; echo "make: $(PYTHON) could not make a virtual environment: on Debian and Ubuntu install the package python3-venv" >&2; exit 1; }

# Installed in place: a change of the source needs no new installation, a change of pyproject.toml does.
$(VENV)/.atc: pyproject.toml | $(BIN)/python
	@echo "installing atc into $(VENV)"
	@$(PIP) -e .
	@touch $@

$(VENV)/.atc-test: pyproject.toml | $(BIN)/python
	@echo "installing atc and what its tests need into $(VENV)"
	@$(PIP) -e ".[test]"
	@touch $@ $(VENV)/.atc

# Large packages that nothing else needs, with demands of their own (Qt): apart from the rest.
$(VENV_TOOLS)/.atc-tools: pyproject.toml | $(BIN)/python
	@echo "installing vtk, pyvista, ovito, openmm, dynasor, euphonic, pint and imdclient into $(VENV_TOOLS)"
	@test -x $(VENV_TOOLS)/bin/python || $(BIN)/python -m venv $(VENV_TOOLS)
	@$(VENV_TOOLS)/bin/python -m pip install --quiet --disable-pip-version-check -e ".[tools]"
	@touch $@

# The site is made from the sources: nothing of atc needs to be installed for it.
$(VENV_DOCS)/.docs: pyproject.toml | $(BIN)/python
	@echo "installing mkdocs-material and mkdocstrings into $(VENV_DOCS)"
	@test -x $(VENV_DOCS)/bin/python || $(BIN)/python -m venv $(VENV_DOCS)
	@$(BIN)/python -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["docs"], sep="\n")' > $(VENV_DOCS)/docs.txt
	@$(VENV_DOCS)/bin/python -m pip install --quiet --disable-pip-version-check -r $(VENV_DOCS)/docs.txt
	@touch $@

docs: $(VENV_DOCS)/.docs
	NO_MKDOCS_2_WARNING=1 $(VENV_DOCS)/bin/mkdocs build --strict
	@echo "site  $(CURDIR)/build/site/index.html"

# ---- the demo

demo: $(OUT)/stress.png $(OUT)/compare.txt
	@echo
	@cat $(OUT)/compare.txt
	@echo
	@echo "fields   $(CURDIR)/$(OUT)/silicon_plate.nc"
	@echo "picture  $(CURDIR)/$(OUT)/stress.png"
	@echo "table    $(CURDIR)/$(OUT)/compare.txt (picture: compare.png)"

$(OUT)/silicon_plate.nc: $(DATA)/scene.toml $(DATA)/silicon_plate.dump.gz $(DATA)/Si.sw $(SOURCES) | $(VENV)/.atc
	@mkdir -p $(OUT)
	$(BIN)/atc fields $(DATA)/scene.toml -o $@ --overwrite -j 0

$(OUT)/stress.png: $(OUT)/silicon_plate.nc
	$(BIN)/atc plot $< -q stress -c xx,yy,xy,vonmises --frame mean -o $@

$(OUT)/compare.txt: $(OUT)/silicon_plate.nc
	$(BIN)/atc compare $< --picture $(OUT)/compare.png > $@

# ---- for developers

lint: | $(VENV)/.atc-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

test: lint
	$(BIN)/python -m pytest -n $(JOBS) --dist loadfile

# One environment for each, with atc and the packages of one extra; nothing of the others.
EXTRA_torch := torch,metatomic
TORCH := $(VENV)-torch/.ready $(VENV)-mace/.ready $(VENV)-nequip/.ready

$(TORCH): $(VENV)-%/.ready: pyproject.toml tests/torch_models/constraints.txt
	@test -n "$(PYTHON)" || { echo "make: no Python 3.11 or newer found: install one, or say make PYTHON=/path/to/python" >&2; exit 1; }
	@echo "making $(@D), with atc and $*"
	@"$(PYTHON)" -m venv $(@D)
	@$(@D)/bin/python -m pip install --quiet --disable-pip-version-check -c tests/torch_models/constraints.txt -e ".[$(or $(EXTRA_$*),$*)]" pytest
	@touch $@

test-torch: $(VENV)-torch/.ready
	$(VENV)-torch/bin/python -m pytest -q tests/torch_models/test_edge_model.py tests/torch_models/test_metatomic.py

test-mace: $(VENV)-mace/.ready
	$(VENV)-mace/bin/python -m pytest -q tests/torch_models/test_mace.py

test-nequip: $(VENV)-nequip/.ready
	$(VENV)-nequip/bin/python -m pytest -q tests/torch_models/test_nequip.py

test-tools: $(VENV_TOOLS)/.atc-tools
	$(VENV_TOOLS)/bin/python -m pytest -q -m tools tests/export/test_viewers.py tests/export/test_pint.py \
		tests/running/test_stream.py tests/upscaling/test_other_phonon_codes.py tests/decomposers/test_openmm.py

bench: | $(VENV)/.atc-test
	@$(BIN)/python -m pytest -q benchmarks/test_standing.py
	@set -e; for b in $(filter-out benchmarks/test_% benchmarks/golden.py,$(wildcard benchmarks/*.py)); do echo "== $$b"; $(BIN)/python $$b; done

clean:
	rm -rf $(OUT) build dist .pytest_cache .ruff_cache .hypothesis *.egg-info
	find atc tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +
	@echo "kept $(VENV), $(VENV_TOOLS) and $(VENV_DOCS): remove them by hand if you want new ones"
