# Every target works from a fresh clone: it first makes .venv if it is missing or out of date.
# With a ROS 2 environment sourced, that environment's rclpy is used instead of the wheels.

PYTHON ?= python3
PY := .venv/bin/python
PACKAGES := msgs_py dap_emulator csg_renderer stereo_recovery model_matcher
READY := .venv/.ready
# Tests use real DDS; it stays on this host.
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
export PYTHONUNBUFFERED := 1
TEST_WORKERS ?= 2

.PHONY: help setup demo test lint bench experiments colcon clean

help:
	@echo 'make demo         render, recover, match: two scenes and a real stereo pair, into demo_out/'
	@echo 'make test         the test suite'
	@echo 'make lint         ruff and mypy'
	@echo 'make bench        speed, beside the tools you might use instead'
	@echo 'make experiments  the tables of the thesis, beside ours'
	@echo 'make colcon       colcon build of src/ inside the virtual environment'

setup: $(READY)

$(READY): requirements.txt requirements-libraries.txt .ci/setup $(PACKAGES:%=src/%/setup.py)
	@PYTHON='$(PYTHON)' sh .ci/setup $(PACKAGES)

demo: $(READY)
	@$(PY) -m model_matcher.closed_form --demo demo_out

test: $(READY)
	ROS_PYTHON_CHECK_FIELDS=1 $(PY) -m pytest -n $(TEST_WORKERS)

lint: $(READY)
	$(PY) -m ruff check src test
	$(PY) -m mypy

bench: $(READY)
	$(PY) test/benchmarks/run.py

experiments: $(READY)
	$(PY) test/experiments/run.py

colcon: $(READY)
	. .venv/bin/activate && colcon build --base-paths src

clean:
	rm -rf .venv build install log demo_out out
