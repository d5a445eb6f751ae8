# Everything runs in .venv; nothing else is installed by hand. Python 3.11 or newer.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test lint demo-check faults clean

demo: $(VENV)/run.stamp
	$(BIN)/pkm-rig calibrate

test: $(VENV)/dev.stamp
	$(BIN)/python -m pytest -n 2

lint: $(VENV)/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Every fault at every operation of a short campaign, one table; ends after an hour and goes on where it was ended.
faults: $(VENV)/dev.stamp
	$(BIN)/python -m tests.faults.sweep $(FAULTS)

# Twenty mock machines, each scored against the plant's own noise-free positions. SEEDS=1,2 for some of them.
demo-check: $(VENV)/run.stamp
	$(BIN)/python benchmarks/demo_check.py $(if $(SEEDS),--seeds $(SEEDS))

$(VENV)/run.stamp: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	touch $@

$(VENV)/dev.stamp: $(VENV)/run.stamp
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

clean:
	rm -rf $(VENV) runs
