# Two commands: `make demo` installs and reconstructs the shipped photo set, `make test` installs and checks everything.
PYTHON ?= python3.11
VENV ?= .venv
BIN := $(VENV)/bin
DEMO := datasets/samples/chair

.PHONY: demo test install lint fast weights clean

demo: install
	$(BIN)/python run_recon.py $(DEMO)/photos --class chair --out out/chair

test: install lint
	$(BIN)/python -m pytest

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

fast: install
	$(BIN)/python -m pytest -m "not slow"

# The shipped weights, made anew (about an hour and a half on 2 cores).
weights: install
	$(BIN)/python -m datasets.synthetic chair --out .cache/data/chair
	$(BIN)/python -m nnproc.train chair
	$(BIN)/python -m nnproc.finish chair --seed 1
	$(BIN)/python -m nnproc.finish chair --seed 3
	$(BIN)/python -m nnproc.finish chair --seed 4 --on-grid-share 0.8

install: $(VENV)/installed

$(VENV)/installed: pyproject.toml install.sh
	PYTHON=$(PYTHON) VENV=$(VENV) bash install.sh
	touch $@

clean:
	rm -rf $(VENV) out
