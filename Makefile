# Two commands: `make demo` installs and reconstructs the shipped photo set, `make test` installs and checks everything.
PYTHON ?= python3.11
VENV ?= .venv
BIN := $(VENV)/bin
DEMO := datasets/samples/chair

.PHONY: demo test install lint fast long weights clean

demo: install
	$(BIN)/python run_recon.py $(DEMO)/photos --class chair --out out/chair

test: install lint
	$(BIN)/python -m pytest

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

fast: install
	$(BIN)/python -m pytest -m "not slow and not long"

long: install
	$(BIN)/python -m pytest -m long

# Networks of all classes by the present recipe; DATA names folders of real objects beside Debian's catalogues. Each
# card says what made the shipped ones, and how long it took.
weights: install
	set -e; for class in bed chair shelf sofa table; do \
	  [ $$class = sofa ] && shapes=10000 || shapes=3000; \
	  $(BIN)/python -m datasets.synthetic paper/$$class --train-on $$shapes --out .cache/data/paper/$$class; \
	  $(BIN)/python -m nnproc.train paper/$$class; \
	  $(BIN)/python -m nnproc.finetune paper/$$class; \
	done
	$(BIN)/python -m datasets.synthetic chair --train-on 0 --train-off 40000 --test-on 0 --test-off 600 \
	  --train-hull 14000 --test-hull 300 --workers 2 --out .cache/data/chair
	$(BIN)/python -m nnproc.inverse chair --data .cache/data/chair --work .cache/train/chair
	$(BIN)/python -m datasets.outlines $(addprefix --data ,$(DATA)) --out .cache/data/outlines
	$(BIN)/python -m nnproc.learn_outlines --data .cache/data/outlines

install: $(VENV)/installed

$(VENV)/installed: pyproject.toml install.sh
	PYTHON=$(PYTHON) VENV=$(VENV) bash install.sh
	touch $@

clean:
	rm -rf $(VENV) out
