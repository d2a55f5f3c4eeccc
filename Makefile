# The few verbs a person types. Everything happens in .venv, made from environment.lock.
# The newest Python that environment.lock serves and this machine has; another: make env PYTHON=...
PYTHON ?= $(shell for v in 3.14 3.13 3.12 3.11; do python$$v -c "" 2>/dev/null && echo python$$v && exit; done; echo python3)
BIN := .venv/bin
# Passed on to trexton book or pytest: make book ARGS=--explain, make test ARGS="-k landing"
ARGS ?=
# Three processes on two cores, each of one thread: many tests wait. Files in their order: the long ones are not
# left for the end.
SPREAD := -n 3 --dist loadfile --no-loadscope-reorder
ALONE := OMP_NUM_THREADS=1 OPENCV_FOR_THREADS_NUM=1
# Where the environment forbids bytecode, each of a hundred processes would compile every source anew.
unexport PYTHONDONTWRITEBYTECODE
# An optional local copy of the public data beside the clone saves the downloads.
ifneq ($(wildcard ../shared/data),)
export TREXTON_DATA ?= $(abspath ../shared/data)
endif

.DEFAULT_GOAL := help
.PHONY: help env book quick prose browser test check coverage test-slow fuzz mutation bench minutes full lab lock crate sbom audit clean rooms frontier proof

help:  ## this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

env: .venv/.ready  ## the environment only (.venv, from environment.lock)

# The lock names everything. --no-deps: left to look for itself, an older pip takes an extra's newest release and
# then finds no hash for it; whether anything is wanting is asked afterwards. uv, itself of the lock, takes less
# than half of pip's time; pip remains for an index that only pip is configured for.
LOCKED := install --quiet --no-deps --require-hashes -r
.venv/.ready: environment.lock pyproject.toml
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 11) <= v <= (3, 14) else f"Python {v[0]}.{v[1]} found, 3.11 to 3.14 needed: install one of them (pip install uv, then uv python install 3.13, brings one), then make env PYTHON=...")'
	@test ! -L .venv || { echo ".venv is a link to $$(readlink .venv), and making the environment would empty that: remove the link, then make env" >&2; exit 1; }
	@echo "making .venv from environment.lock"
	@$(PYTHON) -m venv --clear .venv
	@sed -n '/^uv==/,/[^\\]$$/p' environment.lock > .venv/uv.txt
	@$(BIN)/python -m pip --disable-pip-version-check $(LOCKED) .venv/uv.txt
	@$(BIN)/uv pip $(LOCKED) environment.lock --python $(BIN)/python --no-cache --compile-bytecode 2>/dev/null \
	  || $(BIN)/python -m pip --disable-pip-version-check $(LOCKED) environment.lock
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps --editable .
	@$(BIN)/python -m pip --disable-pip-version-check check
	@touch $@

book: env  ## run the notebooks, build book/_build/html/index.html
	@$(BIN)/trexton book $(ARGS)

quick: env  ## two minutes: the first page, one experiment with its player, its ledger; book/_build/quick/index.html
	@$(BIN)/trexton book --quick $(ARGS)

browser: env  ## every page of the built book in chromium; pictures of ten in book/_build/screenshots
	@TREXTON_BOOK=book/_build/html TREXTON_SCREENSHOTS=book/_build/screenshots \
	  $(BIN)/python -m pytest -n 2 -rs tests/companion/build/test_browser_pages.py tests/companion/build/test_browser_moving.py $(ARGS)

test: env  ## the tests
	@$(ALONE) $(BIN)/python -m pytest -m "not slow" $(SPREAD) $(ARGS)

check: env  ## format, lint, types, import directions, dead code
	@$(BIN)/ruff format --check --quiet .
	@$(BIN)/ruff check --quiet .
	@$(BIN)/mypy
	@$(BIN)/lint-imports --no-logo
	@$(BIN)/vulture

prose: env  ## length of sentences and pages, numbers, idiom: 1 where the book breaks a bound
	@$(BIN)/python tests/plain_book.py

# Two kernels are Python where they are not compiled: what calls them is run again without.
coverage: env  ## branch coverage by module, 95 % at least, with the lines and branches that no test reaches
	@$(BIN)/coverage erase
	@$(ALONE) $(BIN)/python -m pytest -m "not slow" $(SPREAD) --cov --cov-report= $(ARGS)
	@NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest --cov --cov-append --cov-report= \
	  tests/localization/test_neighbors.py tests/vision/test_textons.py
	@$(BIN)/coverage report --fail-under=95

# TREXTON_PACED_S=3600 adds an hour at its own pace, TREXTON_ROS_PYTHON=ENV/bin/python the node with the real rclpy.
test-slow: env  ## the tests that take minutes
	@$(BIN)/python -m pytest -m slow $(ARGS)

fuzz: env  ## damaged and hostile files for ten minutes; what breaks a reader is kept in tests/fuzz_corpus
	@$(BIN)/python tests/fuzzing.py $(ARGS)

mutation: env  ## faults put into five core modules: the share that a test notices, and those that none did
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --target .venv/mutation cosmic-ray==8.7.0 2>/dev/null
	@$(BIN)/python tests/mutation.py $(ARGS)

bench: env  ## speed of every stage, as ratios within one run
	@$(BIN)/trexton bench $(ARGS)

minutes: env  ## the suite and the book from nothing, a sweep on a cluster of two, as ratios within one run (an hour)
	@PYTHONPATH=tests:tests/unneeded $(BIN)/python tests/minutes.py $(or $(ARGS),suite book cluster)

full: env  ## the long sweep of data/sweeps, fine, landings, aiding and survey density over many floors, results to data/reference
	@for plan in data/sweeps/*.toml; do name=$$(basename $$plan .toml); \
	  rm -f results/sweeps/$$name/sweep.json; $(BIN)/trexton sweep $$plan --out results/sweeps/$$name $(ARGS); \
	  cp results/sweeps/$$name/sweep.json data/reference/sweep-$$name.json || exit 1; done
	$(BIN)/trexton run data/flights/sim-survey --test-flight data/flights/sim-waypoints --only fine --out results/full \
	  --set floors=10 frames=2525 training=250 kidnappings=200
	cp results/full/sim-survey/fine.json data/reference/fine.json
	$(BIN)/trexton run data/flights/sim-survey --test-flight data/flights/sim-waypoints --only touchdown \
	  --out results/full --set floors=10 flights=8
	cp results/full/sim-survey/touchdown.json data/reference/touchdown.json
	$(BIN)/trexton run data/flights/sim-survey --test-flight data/flights/sim-waypoints --only aiding \
	  --out results/full --set floors=10 survey=400 frames=250
	cp results/full/sim-survey/aiding.json data/reference/aiding.json
	$(BIN)/trexton run data/flights/sim-survey --test-flight data/flights/sim-waypoints --only density \
	  --out results/full --set floors=10
	cp results/full/sim-survey/density.json data/reference/density.json
	$(MAKE) rooms frontier proof

rooms: env  ## every method in rooms that change, ten floors for a minute each, result to data/reference
	$(BIN)/trexton run data/flights/sim-survey --test-flight data/flights/sim-waypoints --only rooms \
	  --out results/full --set floors=10 survey=800 frames=750
	cp results/full/sim-survey/rooms.json data/reference/rooms.json

frontier: env  ## error against CPU time of every method and peer, ten floors (8 CPU minutes), result to data/reference
	$(ALONE) $(BIN)/python tests/frontier.py

proof: env  ## what autopilots fuse, and wrong places held back, twenty floors (14 CPU minutes), result to data/reference
	$(BIN)/python tests/proof.py $(ARGS)

lab: env  ## open the notebooks in JupyterLab
	@$(BIN)/jupyter lab notebooks

lock:  ## renew environment.lock from pyproject.toml
	$(PYTHON) -m venv .venv-lock && .venv-lock/bin/pip install --quiet uv
	.venv-lock/bin/uv pip compile pyproject.toml --all-extras --universal --python-version 3.11 --generate-hashes --upgrade \
	  --no-emit-index-url --no-emit-find-links --no-annotate --no-header --quiet -o environment.lock
	rm -rf .venv-lock

crate: env  ## one zip of records, data hashes, environment, code and book, as an RO-Crate: results/trexton-crate.zip
	@$(BIN)/python tests/crate.py $(ARGS)

sbom: env  ## what the environment is made of: bom.json (CycloneDX) and licences.csv, in results/supply
	@mkdir -p results/supply
	@$(BIN)/python -m cyclonedx_py environment --output-reproducible --of JSON -o results/supply/bom.json $(BIN)/python
	@$(BIN)/pip-licenses --format=csv --with-urls --output-file=results/supply/licences.csv
	@echo "results/supply/bom.json and results/supply/licences.csv"

audit: env  ## ask the advisory databases about every locked version (needs a network)
	@$(BIN)/pip-audit --disable-pip --require-hashes -r environment.lock

clean:  ## remove the environment, results, caches and the built book
	rm -rf .venv .venv-lock results data/cache data/flights book/_build
