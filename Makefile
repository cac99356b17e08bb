# Everything from a bare clone: each target makes what it needs, and costs nothing where that is there already.
# Needs Python 3.11 or newer as python3, git and make. The caller's environment (certificates, proxies) is kept.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMPS := $(VENV)/stamps
KERNELS := $(STAMPS)/kernels-solver $(STAMPS)/kernels-detectors
# npm and what it starts find the node of the environment first.
NPM    := PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/npm --prefix frontend --no-fund --no-audit
# The Dockerfile builds pages alone, with `LOCKED=pages`.
LOCKED ?= dev
SOURCES := $(shell find apexcal service workers -name '*.py')
FRONTEND_SOURCES := $(shell find frontend -path frontend/node_modules -prune -o -type f -print 2>/dev/null)
API_SOURCES := $(shell find apexcal service -name '*.py' 2>/dev/null)
API_TYPES := frontend/src/lib/api/schema.ts

# What does not wait for one another is made on two cores.
MAKEFLAGS += --jobs=2

.DEFAULT_GOAL := help
.PHONY: help env setup frontend demo serve test test-long compose-test screenshots bench-detection bench-paper bench-accuracy bench-coverage bench-judge bench-drives bench-solver bench-worth bench-fleet bench-growth bench-farm bench-latency bench-retrieval bench-startup bench-annotators bench-marks bench-real bench-neighbours faults faults-hosts check lock clean
.DELETE_ON_ERROR:

help:  ## say what there is
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 18

setup: $(STAMPS)/installed $(STAMPS)/compiled  ## make the environment in .venv

env:  ## write .env and store-identities.json for docker-compose.yml, never over existing ones; ADDRESS=https://NAME
	@$(PYTHON) -m service.environment_file $(if $(ADDRESS),--address $(ADDRESS))

demo: setup $(KERNELS) frontend  ## start the service and drive the whole job through its API (under two minutes)
	$(BIN)/python -m benchmarks.demo

serve: setup frontend  ## leave the service up, with the demo's data where there is some; ARGS="--port 8001"
	$(BIN)/apexcal serve $(ARGS)

test: setup $(KERNELS) $(STAMPS)/walks frontend $(STAMPS)/collected  ## all tests but the long ones, each draw the same at every run; ARGS="tests/apexcal -x"
	$(BIN)/python -m pytest -m "not slow" --hypothesis-profile=ci --draws $(DRAWS) $(SIDE_BY_SIDE) $(ARGS)

test-long: setup $(KERNELS) $(STAMPS)/walks frontend $(STAMPS)/collected  ## all tests, with new draws; DRAWS=7 for those of a run that failed
	$(BIN)/python -m pytest --draws $(DRAWS) $(SIDE_BY_SIDE) $(ARGS)
# Ids, secrets and the order of sets follow from it (tests/support/draws.py).
test: DRAWS := 0
test-long: DRAWS := $(strip $(shell od -An -N4 -tu4 /dev/urandom))
test test-long: export PYTHONHASHSEED = $(DRAWS)
# Four at a time: three start services and mostly wait, the fourth computes; in the order of tests/support/side_by_side.py.
# SIDE_BY_SIDE= runs them one after the other.
SIDE_BY_SIDE ?= -n 4 --dist loadfile
# One thread for linear algebra, as in every worker: idle threads of several processes would keep spinning. The modules
# that pytest rewrites are kept compiled, whatever the caller's environment says.
test test-long: export OPENBLAS_NUM_THREADS = 1
test test-long: export OMP_NUM_THREADS = 1
test test-long $(STAMPS)/collected: export PYTHONDONTWRITEBYTECODE =
$(KERNELS) $(STAMPS)/walks: export OPENBLAS_NUM_THREADS = 1

compose-test: setup frontend $(STAMPS)/containers  ## docker-compose.yml in real containers, by the manual's commands: start, calibrate, replace, back up, restore
	$(BIN)/python -m pytest tests/containers/journey.py -q -s $(ARGS)

screenshots: setup frontend  ## pictures of every page, light and dark, three widths, into docs/images/pages and var/screenshots
	$(BIN)/python -m pytest tests/e2e/screenshots.py -q $(ARGS)

bench-detection: setup  ## accuracy of the detectors on simulated walks, and throughput; SHORT=1 for a short form, ONLY=drawn,streets for parts
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.detection

bench-paper: setup  ## the paper's two recordings, simulated, beside the errors that it reports; SHORT=1 for a short form
	$(BIN)/python -m benchmarks.paper

bench-accuracy: setup  ## how often the solver ends on the optimum, and whether its error bars hold; RIGS=50 for a short form
	$(BIN)/python -m benchmarks.accuracy

bench-coverage: setup  ## whether what a calibration states holds, on data with blunders and shared errors; DRAWS=40 for a short form
	$(BIN)/python -m benchmarks.coverage

bench-judge: setup  ## whether what is published by itself is right, and which check finds what; DRAWS=30 for a short form
	$(BIN)/python -m benchmarks.judge

bench-drives: setup  ## how often a turned camera is noticed on drives, and a sound one accused; DRIVES=1 FRAMES=6 for a short form
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.drives

bench-solver: $(STAMPS)/bench  ## one slot of the genetic algorithm beside the bare evaluation of its individuals, and two peers; ROUNDS=1 for a short form
	$(BIN)/python -m benchmarks.solver

bench-worth: setup  ## where the genetic algorithm helps and where not; RIGS=6 for a short form
	$(BIN)/python -m benchmarks.worth

bench-fleet: setup  ## one request for a thousand vehicles beside the bare solver on the same cores; VEHICLES=50 for a short form
	$(BIN)/python -m benchmarks.fleet

bench-growth: setup  ## how costs grow with recordings, pairs, vehicles and history, as exponents; SHORT=1 for a short form
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.growth

bench-farm: setup  ## what a trip through the queue costs a job, on both databases; SHORT=1 for a short form
	$(BIN)/python -m benchmarks.farm

bench-latency: setup  ## how long one calibration takes by whole runs and by slots, on one and two processes, and replayed on more; ROUNDS=1 for a short form
	$(BIN)/python -m benchmarks.latency

bench-retrieval: setup  ## how fast 10,000 vehicles get their calibrations, and whether any answer is old; SHORT=1 for a short form
	$(BIN)/python -m benchmarks.retrieval

bench-startup: setup frontend  ## seconds until the service answers, and what its processes import; ROUNDS=1 for a short form
	$(BIN)/python -m benchmarks.startup

bench-annotators: setup  ## 1 to 100 people who mark one recording at once, with open pages, on both databases; SHORT=1 for a short form
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.annotators

bench-marks: setup  ## the machine's marks on rendered scenes drawn wide, on scenes without a board and on real recordings, and walks calibrated from them and from people's; SHORT=1 for a short form
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.marks

bench-real: setup  ## the recordings of ../shared/data through `apexcal solve` as a stranger runs it; ONLY=os1 for a part
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.real

bench-neighbours: setup  ## how long a quiet fleet waits beside noisy ones, API limited to 1 GiB, and beside a flood, both databases; SHORT=1 for a short form
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.flood
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.neighbours

faults: setup  ## kill, freeze, cut and fill everything under work, then look at every promise; SECONDS=60 for a short form, SEED, STORE=s3
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.campaign --seconds $(or $(SECONDS),600) $(if $(SEED),--seed $(SEED)) $(if $(STORE),--store $(STORE))

faults-hosts: setup  ## seven hosts in network namespaces (root, ip), fourteen faults of hosts, on S3; SECONDS=60 for a short form, SEED
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.campaign --hosts --seconds $(or $(SECONDS),600) $(if $(SEED),--seed $(SEED))

check: setup $(API_TYPES)  ## style, types, import rules, names
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	PATH="$(CURDIR)/$(BIN):$$PATH" frontend/node_modules/.bin/pyright
	$(BIN)/lint-imports
	$(BIN)/python -m tests.contract.names
	$(NPM) run check

frontend: $(STAMPS)/frontend  ## build the pages into service/web, and the report into workers/reports

lock: $(STAMPS)/uv  ## resolve the requirements again; the files hold hashes and no addresses
	$(BIN)/uv pip compile $(LOCK_FLAGS) requirements/bootstrap.in -o requirements/bootstrap.lock
	$(BIN)/uv pip compile $(LOCK_FLAGS) pyproject.toml --extra all --group dev -o requirements/dev.lock
	$(BIN)/uv pip compile $(LOCK_FLAGS) pyproject.toml --extra serve --group pages -c requirements/dev.lock -o requirements/pages.lock
	for part in serve worker; do $(BIN)/uv pip compile $(LOCK_FLAGS) pyproject.toml --extra $$part -c requirements/dev.lock -o requirements/$$part.lock || exit 1; done
	$(BIN)/uv pip compile $(LOCK_FLAGS) requirements/containers.in -o requirements/containers.lock
	$(BIN)/uv pip compile $(LOCK_FLAGS) pyproject.toml --extra all --group bench -c requirements/dev.lock -o requirements/bench.lock
LOCK_FLAGS := --universal --generate-hashes --python-version 3.11 --no-header --no-emit-index-url --quiet

clean:  ## remove what was built; data in var/ stays
	rm -rf $(VENV) frontend/node_modules $(API_TYPES) service/web workers/reports/report.html dist .pytest_cache .ruff_cache .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(STAMPS)/uv: requirements/bootstrap.lock
	@$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed, this is " + sys.version.split()[0] + ". Say PYTHON=python3.12." if sys.version_info < (3, 11) else 0)'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/bootstrap.lock
	@mkdir -p $(STAMPS) && touch $@

# Compiled at once: a caller whose environment keeps Python from writing bytecode would compile anew at every start.
# uv must install into our environment, whichever one the caller's shell has activated.
$(STAMPS)/installed: export VIRTUAL_ENV = $(CURDIR)/$(VENV)
$(STAMPS)/installed: $(STAMPS)/uv requirements/$(LOCKED).lock pyproject.toml
	$(BIN)/uv pip install --quiet --compile-bytecode --require-hashes -r requirements/$(LOCKED).lock
	$(BIN)/uv pip install --quiet --no-deps --no-build-isolation -e .
	@touch $@

# Our own modules too. A changed file is compiled anew, whatever lies here.
$(STAMPS)/compiled: $(STAMPS)/installed $(SOURCES)
	$(BIN)/python -m compileall -q apexcal service workers
	@touch $@

# Else each process of the first tests would rewrite all of their modules. Beside it, npm installs and builds.
$(STAMPS)/collected: $(STAMPS)/installed
	$(BIN)/python -m pytest --collect-only -q > $(STAMPS)/collected.log 2>&1 || { tail -30 $(STAMPS)/collected.log; exit 1; }
	@touch $@

# Else every process that meets a kernel before another has compiled it compiles it too, workers included: up to 45 s.
$(KERNELS): $(STAMPS)/kernels-%: $(STAMPS)/compiled
	$(BIN)/python -m tests.support.kernels $* > /dev/null
	@touch $@

# Walks that tests share. A simulator that stays the same keeps those that are there.
$(STAMPS)/walks: $(STAMPS)/kernels-detectors $(SOURCES)
	$(BIN)/python -m tests.support.walks
	@touch $@

# Docker Compose and the store's binary, for an engine of our own. Others bring their own.
$(STAMPS)/containers: export VIRTUAL_ENV = $(CURDIR)/$(VENV)
$(STAMPS)/containers: $(STAMPS)/installed requirements/containers.lock
	$(BIN)/uv pip install --quiet --require-hashes -r requirements/containers.lock
	@touch $@

# The benchmarks' peers are large, and only they need them.
$(STAMPS)/bench: export VIRTUAL_ENV = $(CURDIR)/$(VENV)
$(STAMPS)/bench: $(STAMPS)/installed requirements/bench.lock
	$(BIN)/uv pip install --quiet --compile-bytecode --require-hashes -r requirements/bench.lock
	@touch $@

$(STAMPS)/node_modules: $(STAMPS)/installed frontend/package.json frontend/package-lock.json
	$(NPM) ci --silent
	@touch $@

# The pages' types are generated from the service's own description. A description that stays the same keeps its time.
$(STAMPS)/openapi: $(STAMPS)/installed $(API_SOURCES)
	$(BIN)/python -m service.openapi $(STAMPS)/openapi.json
	@touch $@

$(STAMPS)/openapi.json: $(STAMPS)/openapi
	@true

$(API_TYPES): $(STAMPS)/node_modules $(STAMPS)/openapi.json
	$(NPM) run --silent types -- $(CURDIR)/$(STAMPS)/openapi.json

$(STAMPS)/frontend: $(API_TYPES) $(FRONTEND_SOURCES) $(wildcard docs/*.md)
	$(NPM) run --silent build
	@touch $@
