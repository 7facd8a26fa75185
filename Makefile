# `make demo` and `make test` need nothing but Python >= 3.11 with venv: they prepare .venv themselves.
PYTHON ?= python3
VENV := .venv
COMMA := ,
BIN := $(VENV)/bin

# MKL's Pardiso exists for x86-64 only; everywhere else UMFPACK, which NGSolve brings, does the same work
EXTRAS := $(if $(filter x86_64 amd64,$(shell uname -m)),dev$(COMMA)mkl,dev)

.PHONY: demo test docs lint types pytest soak mutate paper mpi clean

demo: $(VENV)/ready
	$(BIN)/ngfsi study compare_tissues --level demo --output runs/demo

test: lint types pytest

# The site, in site/: every link in it leads somewhere, or this fails
docs: $(VENV)/ready
	$(BIN)/sphinx-build --fresh-env --quiet --fail-on-warning --keep-going docs site

lint: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/ready
	$(BIN)/mypy

pytest: $(VENV)/ready
	$(BIN)/pytest -n 2 --dist worksteal

soak: $(VENV)/ready
	$(BIN)/python -m tests.soak docs/soak.md

mutate: $(VENV)/ready
	$(BIN)/python -m tests.mutate docs/mutation.md

paper: $(VENV)/ready
	$(BIN)/ngfsi study compare_tissues --level paper --output runs/paper

# Several processes need Debian's petsc4py, which is built for its Python and for NumPy 1 (docs/parallel.md)
MPI := .venv-mpi
PETSC := $(firstword $(wildcard /usr/lib/petscdir/petsc*/*-real/lib/python3/dist-packages))

mpi: $(MPI)/ready

$(MPI)/ready: pyproject.toml constraints.txt
	@test -n "$(PETSC)" || { echo "petsc4py is not here: apt-get install --no-install-recommends python3-petsc4py \
	python3-mpi4py openmpi-bin libopenblas0-serial"; exit 1; }
	/usr/bin/python3 -m venv --system-site-packages $(MPI)
	echo $(PETSC) > $$(echo $(MPI)/lib/python3*/site-packages)/petsc.pth
	sed 's/^numpy==.*/numpy==1.26.4/' constraints.txt > $(MPI)/constraints.txt
	$(MPI)/bin/python -m pip install --quiet --disable-pip-version-check -c $(MPI)/constraints.txt -e .
	touch $@

$(VENV)/ready: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "ngfsi needs Python 3.11 or newer, this is " + sys.version)'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[$(EXTRAS)]"
	touch $@

clean:
	rm -rf $(VENV) $(MPI) .mypy_cache .pytest_cache .ruff_cache
