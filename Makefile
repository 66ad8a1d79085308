# `make demo` and `make test` do all of the set-up by themselves, into .venv; the second time it costs nothing.
#
# PYTHON     the interpreter to start from (default: the first Python 3.11 found)
# PIP_ARGS   passed to pip install. PyPI's torch for Linux brings several GB of CUDA; to get the CPU build name
#            the index that holds it: make setup PIP_ARGS="--extra-index-url URL"

VENV := .venv
BIN := $(VENV)/bin
PIP_ARGS ?=
PYTHON ?= $(shell for p in python3.11 python3 python; do \
  $$p -c 'import sys, venv, ensurepip; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null && echo $$p && break; done)
PIP := $(BIN)/python -m pip install -qq --disable-pip-version-check -c constraints.txt $(PIP_ARGS)

.PHONY: help setup demo test check docs format clean
help:
	@echo "make setup   install into $(VENV)"
	@echo "make demo    photos of four bundled scenes -> surfaces, grasps and pictures in outputs/demo"
	@echo "make test    all tests, with PyBullet and Blender"
	@echo "make check   ruff, mypy, codespell"
	@echo "make docs    the documentation as a site in outputs/docs"

$(VENV)/made:
	@test -n "$(PYTHON)" || { echo "No Python 3.11 with venv and ensurepip found. Debian, Ubuntu: apt install python3.11 python3.11-venv" >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV)
	@touch $@

# The program alone: enough to predict.
$(VENV)/core: $(VENV)/made pyproject.toml constraints.txt
	@echo "Installing neugrasp into $(VENV) (a few minutes the first time) ..."
	@$(PIP) -e .
	@touch $@

$(VENV)/all: $(VENV)/core
	@echo "Installing PyBullet, Blender and the development tools into $(VENV) ..."
	@$(PIP) -e '.[all]'
	@.ci/blender-libraries $(VENV)/libraries $(BIN)/python
	@touch $@

$(VENV)/docs: $(VENV)/core
	@$(PIP) -e '.[docs]'
	@touch $@

setup: $(VENV)/all
	@:

demo: $(VENV)/core
	@$(BIN)/neugrasp demo --out outputs/demo

test: $(VENV)/all
	@LD_LIBRARY_PATH="$(CURDIR)/$(VENV)/libraries$${LD_LIBRARY_PATH:+:$$LD_LIBRARY_PATH}" \
	  OMP_NUM_THREADS=1 $(BIN)/python -m pytest -m "not gpu and not robot" -n 2 --dist worksteal

check: $(VENV)/all
	@$(BIN)/ruff check --quiet .
	@$(BIN)/ruff format --quiet --check .
	@$(BIN)/mypy --no-error-summary
	@$(BIN)/codespell src tests docs examples README.md CHANGELOG.md CONTRIBUTING.md
	@echo "check: ruff, mypy and codespell have nothing to say"

docs: $(VENV)/docs
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
	@echo "outputs/docs/index.html"

format: $(VENV)/all
	@$(BIN)/ruff check --quiet --fix .
	@$(BIN)/ruff format --quiet .

clean:
	rm -rf $(VENV) outputs build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
