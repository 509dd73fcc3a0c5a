# Everything a newcomer types. A fresh machine needs Python >= 3.11, git, make and a C compiler, which is installed where
# that is possible; the rest comes from the lock file.
#
#   make demo       identify, verify and simulate; writes out/demo/report.html
#   make test       all tests; CPU_SECONDS=4500: an error if they take more
#   make coverage   all tests, and the lines that they have run
#   make check      lint, format, types, layers
#   make drivers    others' drivers of controllers in an environment of their own, for the tests
#   make mutation   flips signs in the physics and asks the tests to notice; SAMPLE=100 for that many, of which nine tenths do, FILES=friction/ for some
#   make lines-c    counts the lines of the engine's C that its tests run; below 95 % is an error
#   make bench      everything measured beside other tools: docs/benchmarks/; PART=fit for one part
#   make studies    rates over random models, recordings, faults and files: docs/benchmarks/, and all figures; hours; STUDY=random_orbits for one
#   make figures    the figures of the pages: docs/figures/
#   make release    dry run of a release: builds, checks, tests of the wheel in clean environments (RELEASING.md)
#   make docs       the documentation, out/docs/index.html; every warning is an error (needs gcc)
#   make site       the documentation to host, a folder for each version in out/site; SITE_URL= where it will be
#   make links      asks the network whether the addresses in the documentation are still there
#   make lowest     a core of the tests with the lowest versions that pyproject.toml allows; PYTHON= one of them
#   make engine     build the engine again, after an edit of its C
#   make laws       write the C of the friction laws again, after an edit of their Python functions
#   make lock       resolve the dependencies anew (LOCK_FLAGS=--upgrade for newer versions)

PYTHON ?= python3
UV := uv==0.13.8
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

# Three processes suit two cores, for browsers and devices are waited for; a file to each: what its tests share (a
# server, a browser) is made once.
PYTEST ?= $(BIN)/python -m pytest -q -n 3 --dist loadfile --no-loadscope-reorder
# How many CPU seconds all tests may take together; any number if empty. Their sums by folder are printed at the end.
CPU_SECONDS ?=
# Share of the lines that the tests run, in %.
COVERAGE ?= 95
LOCK_FLAGS ?=
# Of a release: those that the wheel is tested with.
PYTHONS ?= 3.11 3.12 3.13
# Where the site is hosted, for its sitemap.
SITE_URL ?= https://stickslip.github.io/stickslip
# Of trajectory, steady, ensemble, fit, accuracy, startup; all of them if empty.
PART ?=
# Where another version of a dependency shows: units, data, files, the command line, figures, reports, fits.
LOWEST_TESTS := tests/quantities tests/jobs/test_known.py tests/cli/test_commands.py \
  tests/test_mistyped_keys.py tests/parameters tests/recording tests/report/figures \
  tests/friction/test_contract.py tests/engine/test_step.py tests/simulation/test_state.py tests/estimate/test_fit.py \
  tests/identify/test_saved.py tests/rig/test_gate.py tests/twins/test_pair.py tests/report/test_document.py \
  tests/report/test_html.py tests/report/test_results.py tests/report/test_writing.py \
  tests/jobs/analysis/test_verification.py
LOWEST := .venv-lowest
# Other tools, only for the benchmarks, in an environment of their own.
PEERS := .venv-peers
# Others' drivers and frameworks of laboratories, which tests run against twins and rigs.
DRIVERS := .venv-drivers

.DEFAULT_GOAL := help
.PHONY: help setup demo test coverage tools drivers check format mutation lines-c bench studies figures release docs site links peers lowest engine laws lock clean

help:
	@sed -n 's/^#   //p' Makefile

setup: $(READY)

# The stamp goes first and comes last: a set-up that was interrupted starts again from an empty environment.
# Byte code is written here, once: where Python is told not to write any (in many containers), each process would
# compile all that it imports, which makes a first simulation three times as long. The install's own finder of modules
# goes, for it would hide what PYTHONPATH names; the library is beside its Python, so that a path is enough.
$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "stickslip needs Python 3.11 or newer; name one with: make PYTHON=python3.12 ..." >&2; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' || { \
	  echo "$(PYTHON) has no venv module; install it (Debian: apt install python3-venv)" >&2; exit 1; }
	@command -v $(firstword $(CC)) >/dev/null || { echo "installing a C compiler ..." >&2; \
	  { apt-get update -qq && apt-get install -y -qq --no-install-recommends gcc libc6-dev; } >/dev/null 2>&1; } || { \
	  echo "stickslip needs a C compiler (Debian: apt install gcc libc6-dev; macOS: xcode-select --install)" >&2; exit 1; }
	@if [ -e $(READY) ]; then rm -f $(READY); else rm -rf $(VENV) && $(PYTHON) -m venv $(VENV); fi
	@if $(BIN)/python -m pip install --quiet --disable-pip-version-check $(UV); then \
	  install="$(BIN)/uv pip install --quiet --compile-bytecode --python $(BIN)/python"; \
	else \
	  echo "uv cannot be installed here; going on with pip, which is slower" >&2; \
	  install="$(BIN)/python -m pip install --quiet --disable-pip-version-check"; \
	fi; \
	echo "installing the locked dependencies into $(VENV) ..." >&2; \
	$$install --require-hashes -r requirements.lock && $$install --no-deps --no-build-isolation -e .
	@for paths in $(VENV)/lib/python*/site-packages/_editable_skbc_stickslip.pth; do \
	  sed '/^import /d' $$paths > $$paths.new && mv $$paths.new $$paths; done
	@$(BIN)/python -m compileall -q src/stickslip
	@touch $(READY)

demo: $(READY) engine
	$(BIN)/stickslip demo --out out/demo

test: $(READY) engine tools drivers
	$(PYTEST) -p tools.cpu_seconds $(if $(CPU_SECONDS),--cpu-budget $(CPU_SECONDS))

# On its own, for counting lines makes the tests take 1.4 times as long.
coverage: $(READY) engine tools drivers
	$(PYTEST) --cov --cov-fail-under=$(COVERAGE)

# The tests drive the panel in a real browser, and compile exported models and the kernel of a GPU. The shell is that
# browser without windows, which take most of its computing; without it, the tests of the panel take chromium itself.
tools:
	@for tool in chromium chromium-headless-shell gcc g++ cmake; do command -v $$tool >/dev/null || { echo "installing $$tool for the tests ..." >&2; \
	  { apt-get update -qq && apt-get install -y -qq --no-install-recommends $$tool libc6-dev; } >/dev/null 2>&1; } || \
	  echo "$$tool is not there and cannot be installed: tests that need it will fail" >&2; done

# The maker of the NV200 says of its library that it needs Python 3.12; what is used of it runs on 3.11 as well. BLISS
# asks for all of a beamline; here is what its driver of the MCS2 imports.
drivers: $(DRIVERS)/.ready

$(DRIVERS)/.ready: tests/twins/drivers/requirements.txt tests/twins/drivers/alone.txt | $(READY)
	@rm -rf $(DRIVERS) && $(BIN)/uv venv --quiet --python $(BIN)/python $(DRIVERS)
	@install="$(BIN)/uv pip install --quiet --compile-bytecode --python $(DRIVERS)/bin/python --require-hashes --no-deps"; \
	echo "installing others' drivers into $(DRIVERS), for the tests ..." >&2; \
	$$install -r tests/twins/drivers/requirements.txt && \
	$$install --python-version 3.13 -r tests/twins/drivers/alone.txt
	@touch $@

check: $(READY)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright
	$(BIN)/lint-imports

format: $(READY)
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

laws: $(READY)
	$(BIN)/python -m tools.generate_engine

# The install has configured it: what is up to date stays.
engine: $(READY)
	@$(BIN)/cmake --build native >/dev/null

mutation: $(READY)
	$(BIN)/python tools/mutate.py $(if $(SAMPLE),--sample $(SAMPLE)) $(FILES)

lines-c: $(READY) engine
	$(BIN)/python tools/cover_c.py

bench: $(READY) peers
	$(BIN)/python -m benchmarks $(PART)

bench-%: $(READY) peers
	$(BIN)/python -m benchmarks $*

# Most have a page in docs/benchmarks/; the tests keep a small case of each.
of_random_actuators := 2000 --seed 21
of_random_orbits := 1500 --seed 21
of_random_piezos := 300 --seed 0
of_fuzz_engine := --count 100000
of_faults := 1000 --seed 15
of_instruments := 200 out/instruments.jsonl
of_coverage := 300 out/coverage.zarr
of_hysteresis := 100 190
of_lack_of_fit := 100
of_zero_parameter := 12 out/zero-parameter.json
of_folder_fuzz := 1000 --seed 0
of_intervals := 40
of_real_moves := 320
of_open_loop := 400
STUDY ?= random_actuators random_orbits random_piezos fuzz_engine faults instruments coverage hysteresis lack_of_fit \
  zero_parameter folder_fuzz hostile_files intervals real_moves open_loop plausibility
studies: $(READY) engine $(addprefix study-,$(STUDY)) figures

study-%: $(READY) engine
	@mkdir -p out
	$(BIN)/python -m benchmarks.$* $(of_$*)

figures: $(READY) engine tools
	$(BIN)/python examples/gallery.py docs
	$(BIN)/python -m tests.panel.pictures
	$(BIN)/python -m benchmarks.results docs/gallery.md

release: $(READY)
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python tools/check_release.py $(PYTHONS)

docs: $(READY)
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs out/docs

site: $(READY)
	$(BIN)/python -m tools.site out/site $(SITE_URL)

links: $(READY)
	$(BIN)/python -m sphinx -q -b linkcheck -D nb_execution_mode=off docs out/links

# A tool that cannot be installed is a row that says so: numbalsoda needs a Fortran compiler, Octave is not of Python.
peers: $(PEERS)/.ready

$(PEERS)/.ready: benchmarks/peers/requirements.txt benchmarks/peers/numbalsoda.txt $(READY)
	@rm -rf $(PEERS) && $(BIN)/uv venv --quiet --python $(BIN)/python $(PEERS)
	@install="$(BIN)/uv pip install --quiet --python $(PEERS)/bin/python --require-hashes --no-deps"; \
	echo "installing the tools to compare with into $(PEERS) ..." >&2; \
	$$install -r benchmarks/peers/requirements.txt && { \
	  CMAKE_POLICY_VERSION_MINIMUM=3.5 $$install -r benchmarks/peers/numbalsoda.txt || \
	  echo "numbalsoda, which needs gfortran and cmake, was not installed (Debian: apt install gfortran cmake)" >&2; }
	@command -v octave-cli >/dev/null || echo "GNU Octave is not installed (Debian: apt install octave)" >&2
	@touch $@

# In an environment of its own; what was deprecated since is only told.
lowest: $(READY)
	@rm -rf $(LOWEST) && $(BIN)/uv venv --quiet --python $(PYTHON) $(LOWEST)
	$(BIN)/uv pip compile --quiet --resolution lowest-direct --python $(LOWEST)/bin/python --extra all --extra numba --extra parquet \
	  pyproject.toml -o $(LOWEST)/requirements.txt
	$(BIN)/uv pip install --quiet --python $(LOWEST)/bin/python -r $(LOWEST)/requirements.txt pytest hypothesis httpx
	$(BIN)/uv pip install --quiet --python $(LOWEST)/bin/python --no-deps .
	$(LOWEST)/bin/python -m pytest -q -p no:cacheprovider -o filterwarnings=default $(LOWEST_TESTS)

lock: $(READY)
	$(BIN)/uv pip compile --quiet --universal --fork-strategy fewest --python-version 3.11 --extra dev \
	  --generate-hashes --no-emit-index-url --custom-compile-command "make lock" $(LOCK_FLAGS) \
	  pyproject.toml -o requirements.lock
	$(BIN)/uv pip compile --quiet --python-version 3.11 --generate-hashes --no-emit-index-url \
	  --custom-compile-command "make lock" $(LOCK_FLAGS) benchmarks/peers/requirements.in -o benchmarks/peers/requirements.txt
	$(BIN)/uv pip compile --quiet --universal --fork-strategy fewest --python-version 3.11 --generate-hashes \
	  --no-emit-index-url --custom-compile-command "make lock" $(LOCK_FLAGS) -c requirements.lock \
	  tests/twins/drivers/requirements.in -o tests/twins/drivers/requirements.txt

clean:
	git clean -qfX native src/stickslip/engine
	rm -rf $(VENV) $(PEERS) $(DRIVERS) $(LOWEST) out .pytest_cache .ruff_cache .import_linter_cache .hypothesis .coverage*
