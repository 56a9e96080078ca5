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

.PHONY: help setup demo test test-oldest coverage mutants lint bench experiments docs site stress fresh-seeds colcon wheels release clean

help:
	@echo 'make demo         render, recover, match, track: scenes and a real stereo pair, into demo_out/'
	@echo 'make test         the test suite'
	@echo 'make test-oldest  the same on the oldest supported versions (needs python3.12; OLDEST_PYTHON names another)'
	@echo 'make coverage     how much of the pure modules the tests run, into out/coverage/index.html'
	@echo 'make mutants      whether the tests notice small changes of the code, by sample, into test/mutation/SURVIVORS.md'
	@echo 'make lint         ruff and mypy'
	@echo 'make bench        speed, beside the tools you might use instead'
	@echo 'make experiments  the tables of the thesis, beside ours'
	@echo 'make docs         tables, parameter files and pictures of the pages, from the code; then the site'
	@echo 'make site         the HTML site alone, with the reference, into out/site/html'
	@echo 'make stress       10,000 malformed messages, 5,000 files, 10,000 stereo pairs in one process, 45 restarts, 20,000 certificates, the Dockerfile'
	@echo 'make fresh-seeds  the property tests with seeds of this moment and many examples (part of stress)'
	@echo 'make wheels       the five packages as wheels, into out/wheels'
	@echo 'make release      wheels; then bloom and rosdep on a stored list of the distribution, into out/bloom'
	@echo 'make colcon       colcon build of src/ inside the virtual environment'

setup: $(READY)

$(READY): requirements.txt requirements-libraries.txt .ci/setup $(PACKAGES:%=src/%/setup.cfg)
	@PYTHON='$(PYTHON)' sh .ci/setup $(PACKAGES)

demo: $(READY)
	@$(PY) -m model_matcher.closed_form --demo demo_out

test: $(READY)
	$(PY) test/prepare.py
	ROS_PYTHON_CHECK_FIELDS=1 $(PY) -m pytest -n $(TEST_WORKERS)

# Python 3.12 with what Ubuntu 24.04 ships. The ROS wheels bring lark 0.12; Ubuntu has lark 1.1.
OLDEST_PYTHON ?= python3.12
OLDEST := .venv-oldest/.ready

$(OLDEST): requirements-oldest.txt $(PACKAGES:%=src/%/setup.cfg)
	@command -v $(OLDEST_PYTHON) >/dev/null || { echo 'no $(OLDEST_PYTHON): make OLDEST_PYTHON=... test-oldest' >&2; exit 1; }
	$(OLDEST_PYTHON) -m venv .venv-oldest
	.venv-oldest/bin/python -m pip install --quiet --disable-pip-version-check -r requirements-oldest.txt
	.venv-oldest/bin/python -m pip uninstall --quiet --yes lark-parser
	.venv-oldest/bin/python -m pip install --quiet --disable-pip-version-check lark==1.1.9
	.venv-oldest/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation \
	    --use-pep517 $(PACKAGES:%=-e src/%)
	touch $@

test-oldest: $(OLDEST)
	.venv-oldest/bin/python test/prepare.py
	ROS_PYTHON_CHECK_FIELDS=1 .venv-oldest/bin/python -m pytest -n $(TEST_WORKERS)

# Compiled functions once more as plain Python, where a test is of one of them or of a small scene: whole pictures, nodes
# and long searches would take hours.
files = $(foreach name,$(2),src/$(1)/test/test_$(name).py)
INTERPRETED := $(call files,csg_renderer,behind_terrain engines_agree light_and_samples occlusion outline ray_casting \
    render_frame terrain tree_order visibility) \
  $(call files,stereo_recovery,bounds buckets chains curve_geometry edgels estimate factors inliers joining \
    junction_edges labelling noise parallel_groups row_error texture view view_votes) \
  $(call files,model_matcher,constraints engine_dap equal_poses evidence image_pose outline_neighbours pair_bounds pair_pose pair_test \
    parallel_search pose_fit prefilter presence proof proof_work sightlines symmetry tracking tree views)

coverage: $(READY)
	rm -rf out/coverage
	mkdir -p out/coverage
	ROS_PYTHON_CHECK_FIELDS=1 $(PY) -m coverage run -m pytest -n $(TEST_WORKERS)
	$(PY) -m coverage run -m pytest -n $(TEST_WORKERS) --interpreted 3 $(INTERPRETED)
	$(PY) -m coverage combine --quiet
	$(PY) -m coverage html --quiet --directory out/coverage
	$(PY) -m coverage report --skip-covered --sort=cover

mutants: $(READY)
	$(PY) test/mutation/run.py

lint: $(READY)
	$(PY) -m ruff format --check src test
	$(PY) -m ruff check src test
	$(PY) -m mypy

bench: $(READY)
	$(PY) test/benchmarks/run.py

experiments: $(READY)
	$(PY) test/experiments/run.py

docs: $(READY)
	$(PY) test/docs/generate.py
	$(PY) test/docs/pictures.py
	$(PY) test/docs/gallery.py
	$(PY) test/docs/camera_pictures.py
	$(MAKE) site

DOCS_READY := .venv/.docs-ready

$(DOCS_READY): $(READY) requirements-docs.txt
	$(PY) -m pip install --quiet --disable-pip-version-check -r requirements-docs.txt
	@touch $@

site: $(DOCS_READY)
	NO_MKDOCS_2_WARNING=1 $(PY) test/docs/site.py

stress: $(READY)
	$(PY) test/stress/fuzz.py --messages 10000
	$(PY) test/stress/fuzz_files.py --files 5000
	$(PY) test/stress/hostile.py --calls 1000 --programs 100
	$(PY) test/stress/soak.py --pairs 10000
	$(MAKE) fresh-seeds
	$(PY) test/stress/restart.py --rounds 3
	$(PY) test/stress/certificates.py --cases 20000
	$(PY) test/stress/container.py

# Property tests on examples that no run has seen before; the pinned seed of pyproject.toml is for commits.
fresh-seeds: $(READY)
	for run in 1 2 3; do ROS_PYTHON_CHECK_FIELDS=1 $(PY) -m pytest -n $(TEST_WORKERS) -m hypothesis \
	    --hypothesis-seed=random --hypothesis-profile=many --timeout 1200 || exit 1; done

colcon: $(READY)
	. .venv/bin/activate && colcon build --base-paths src

wheels: $(READY)
	$(PY) test/release/wheels.py out/wheels

release: wheels
	$(PY) test/release/dry_run.py out/bloom

clean:
	rm -rf .venv .venv-oldest build install log demo_out out
