# Two commands on a fresh machine: `make test` and `make demo`. Every target sets up what it needs,
# once: .venv from requirements.lock, the native core from native/, the project itself.

PYTHON_RUN := .venv/bin/python
ENVIRONMENT := .venv/.environment
NATIVE := .venv/.native
PROJECT := .venv/.project
# Folders are listed too: theirs is the time that changes when a file is removed.
NATIVE_SOURCES := $(shell find native -mindepth 1 -name build -prune -o -name __pycache__ -prune -o -print)

.DEFAULT_GOAL := help
.PHONY: help setup native test demo bench accuracy witness recommendations gallery mutations sanitize double properties extension window lint format lock clean

help:
	@echo "make test       run the tests"
	@echo "make demo       compare every model on a real volume; see build/demo/report.html"
	@echo "make bench      time the kernels"
	@echo "make accuracy   measure every model's numerical error on real volumes: docs/accuracy.md"
	@echo "make witness    test photon mapping against Cycles on real volumes by z-test: docs/witness.md"
	@echo "make recommendations  measure what the analysis recommends: docs/recommendations.md"
	@echo "make gallery    render the standard scenes: docs/gallery.md"
	@echo "make mutations  plant known faults and check that the tests notice"
	@echo "make sanitize   run the kernels' tests under address, undefined and thread sanitizers"
	@echo "make double     compare the kernels with ones built in double precision: docs/precision.md"
	@echo "make properties examine the models in many random scenes (VOLILLUM_SCENES=100 of each)"
	@echo "make extension  build the Blender extension, dist/*.zip"
	@echo "make window     use the extension by hand in a real Blender's window (Linux, root)"
	@echo "make lint       check style, types and formatting"
	@echo "make format     apply the formatting that lint asks for"
	@echo "make setup      only set up .venv and the native core, as all of these do by themselves"
	@echo "make lock       pin the newest versions in requirements.lock (needs uv)"
	@echo "make clean      remove all that was built, except .venv"
	@echo
	@echo "A C++ compiler and CPython 3.13 are needed; PYTHON=... names one that is not found."
	@echo "VOLILLUM_DATA=... names the folder of third-party volumes; tests that need it skip without."
	@echo "VOLILLUM_WINDOW_BLENDER=... names the folder of the system that \`make window\` makes once."

setup: $(NATIVE) $(PROJECT)

native: $(NATIVE)

$(ENVIRONMENT): requirements.lock tools/make_environment.sh tools/find_python.sh
	@tools/make_environment.sh

$(NATIVE): $(ENVIRONMENT) tools/build_native.sh $(NATIVE_SOURCES)
	@tools/build_native.sh
	@touch $@

$(PROJECT): $(ENVIRONMENT) pyproject.toml
	@$(PYTHON_RUN) -m pip install --disable-pip-version-check --quiet --no-deps \
		--no-build-isolation --editable .
	@touch $@

test: setup
	@$(PYTHON_RUN) -m pytest $(ARGS)

demo: setup
	@$(PYTHON_RUN) -m volillum_addon demo -o build/demo $(ARGS)

bench: setup
	@for script in tests/benchmarks/bench_*.py; do $(PYTHON_RUN) $$script $(ARGS) || exit 1; done

accuracy: setup
	@$(PYTHON_RUN) tests/benchmarks/accuracy.py -o docs/accuracy.md $(ARGS)

witness: setup
	@$(PYTHON_RUN) tests/benchmarks/witness.py -o docs/witness.md $(ARGS)

recommendations: setup
	@$(PYTHON_RUN) tests/benchmarks/recommendations.py -o docs/recommendations.md $(ARGS)

gallery: setup
	@$(PYTHON_RUN) -m volillum_addon gallery all -o build/gallery $(ARGS)
	@$(PYTHON_RUN) tests/benchmarks/gallery.py -o docs/gallery.md

mutations: setup
	@$(PYTHON_RUN) tests/mutations/run.py $(ARGS)

sanitize: setup
	@tools/sanitize.sh $(SANITIZERS)

double: setup
	@tools/build_variant.sh double -DVOLILLUM_REAL=double
	@$(PYTHON_RUN) tests/benchmarks/precision.py -o docs/precision.md $(ARGS)

VOLILLUM_SCENES ?= 100
VOLILLUM_SEED ?= $(shell date +%s)

properties: setup
	@echo "VOLILLUM_SEED=$(VOLILLUM_SEED)"
	@VOLILLUM_SCENES=$(VOLILLUM_SCENES) VOLILLUM_SEED=$(VOLILLUM_SEED) \
		$(PYTHON_RUN) -m pytest tests/hard_cases/test_properties.py $(ARGS)

extension: setup
	@$(PYTHON_RUN) tools/build_extension.py

window: extension
	@$(PYTHON_RUN) -m pytest tests/window $(ARGS)

lint: setup
	@tools/lint.sh

format: $(ENVIRONMENT)
	@.venv/bin/ruff check --quiet --fix-only .
	@.venv/bin/ruff format --quiet .
	@find native -name build -prune -o \( -name '*.h' -o -name '*.cpp' \) -print | \
		xargs .venv/bin/clang-format -i

lock:
	@uv pip compile pyproject.toml --group dev --universal --python-version 3.13 --upgrade \
		--generate-hashes --custom-compile-command "make lock" --quiet \
		--output-file requirements.lock

clean:
	@rm -rf build dist wheels native/build
	@rm -f $(NATIVE)
