# Two commands do everything: `make demo` and `make test`. Each sets up .venv from the lock file first.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed

.PHONY: demo test test-long test-quick lint docs bench bench-discovery lock clean

$(STAMP): requirements.lock pyproject.toml
	@echo "Setting up $(VENV) from requirements.lock (two minutes, five on a slow machine; once) ..."
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "gravcal needs Python 3.11 or newer: make PYTHON=python3.12 ..."; exit 1; }
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install -qq --disable-pip-version-check --no-deps --require-hashes -r requirements.lock
	@$(BIN)/python -m pip install -qq --disable-pip-version-check --no-deps --no-build-isolation -e .
	@echo "Compiling (half a minute, once) ..."
	@$(BIN)/python -m compileall -q gravcal flows tasks catalog
	@aside=$$(mktemp -d); export GRAVCAL_PRODUCTS=$$aside/products; \
	  $(BIN)/gravcal simulate com_offset --out $$aside/files > /dev/null && \
	  $(BIN)/gravcal run com_offset --data $$aside/files --engine inline > /dev/null; \
	  done=$$?; rm -rf $$aside; exit $$done
	@touch $@

demo: $(STAMP)  ## simulate a calibration day, process it, print estimate against truth
	@$(BIN)/gravcal demo

PYTEST := $(BIN)/python -m pytest -q -n 2 --dist loadfile --no-loadscope-reorder
test: $(STAMP)  ## all tests but the long ones, ten minutes on two cores; files share their setup
	@$(PYTEST) -m "not long"

test-long: $(STAMP)  ## the long ones: effects hidden in whole records, mutated files, the site; as long again
	@$(PYTEST) -m long

QUICK := tests/physics tests/estimation tests/effects tests/io tests/store tests/catalog tests/published \
  tests/test_architecture.py tests/test_stages.py tests/flows/test_cli.py tests/flows/test_plan.py \
  tests/calibrations/gradient_torque/test_gradient_torque_flow.py
test-quick: $(STAMP)  ## what tells most of a change: a minute and a half on two cores
	@$(BIN)/python -m pytest -q -n 2 --dist worksteal $(QUICK)

lint: $(STAMP)  ## formatting and static checks
	@$(BIN)/ruff format --check . && $(BIN)/ruff check .

docs: $(STAMP)  ## the site, into build/docs; no network, warnings are errors
	@$(BIN)/python -m sphinx -q -W --keep-going -b html docs build/docs
	@echo "build/docs/index.html"

bench: $(STAMP)  ## recovery study and speed ratios; long
	@$(BIN)/python -m benchmarks

bench-discovery: $(STAMP)  ## effects hidden in the project's own world; hours, goes on where it stopped
	@for sort in clean listed; do $(BIN)/python -m benchmarks worlds --calibration com_offset --world own --sort $$sort --runs 200; done

lock:  ## resolve requirements.lock anew; needs uv
	uv pip compile --universal --generate-hashes --no-header --no-annotate --python-version 3.11 \
	  --extra test --extra bench --extra browse --extra docs pyproject.toml -o requirements.lock

clean:
	rm -rf $(VENV) build dist *.egg-info
