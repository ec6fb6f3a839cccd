# Everything runs in .venv, against the installed wheel, never against the source tree.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
WHEEL := dist/.installed
SOURCES := Cargo.toml Cargo.lock pyproject.toml $(shell find rust python -name '*.rs' -o -name '*.py' -o -name '*.pyi' -o -name '*.html' -o -name Cargo.toml)

DISPATCHED := from numpy._core._multiarray_umath import __cpu_dispatch__ as names; print(*names)
# file by file on all cores, in the order of `tests/conftest.py`
SPREAD := -n auto --dist loadscope --no-loadscope-reorder
# files of tests that compare with the reference in NumPy; `tests/compared.py` finds these tests
COMPARED = $(shell grep -lrE '^(from|import) reference' tests --include='test_*.py')

.PHONY: demo test test-rust test-python test-examples test-stubs test-baseline lint lint-rust lint-python
.PHONY: docs figures bench counts clean

# a recording of your own: make demo PLOTS="a.csv b.csv" SENSORS=sensors.toml, and if there are any PLANS=,
# TRUTH=, and OPTIONS= as in tertia report --help
PLOTS :=
SENSORS :=
PLANS :=
TRUTH :=
OPTIONS :=

demo: $(WHEEL)
ifeq ($(PLOTS),)
	$(BIN)/tertia simulate demo
	$(BIN)/tertia report demo/plots.csv --sensors demo/sensors.toml --plans demo/plans.json \
		--truth demo/truth.csv --bearings demo/bearings.csv --by target \
		--output demo/report.html
else
	mkdir -p demo
	$(BIN)/tertia report $(PLOTS) $(if $(SENSORS),--sensors $(SENSORS)) $(if $(PLANS),--plans $(PLANS)) \
		$(if $(TRUTH),--truth $(TRUTH)) $(OPTIONS) --output demo/report.html
endif
	@echo "The report is in demo/report.html: open it in a browser"

# one test to a core: NumPy's linear algebra needs no threads of its own
test-python test-baseline: export OPENBLAS_NUM_THREADS = 1

test: test-rust test-python test-examples test-stubs

# the core; the bindings are tested from Python
test-rust:
	cargo test

test-python: $(WHEEL) $(VENV)/.test
	$(BIN)/python -m pytest $(SPREAD)

test-examples: $(WHEEL) $(VENV)/.test
	$(BIN)/python -m pytest --doctest-modules --pyargs tertia --ignore-glob="*/interop/traffic.py"

test-stubs: $(WHEEL) $(VENV)/.test
	$(BIN)/python -m mypy.stubtest tertia._core

# once more what compares with NumPy, with its vector loops switched off: no test depends on rounding
test-baseline: $(WHEEL) $(VENV)/.test
	NPY_DISABLE_CPU_FEATURES="$$($(BIN)/python -c '$(DISPATCHED)')" OPENBLAS_CORETYPE=Nehalem \
		$(BIN)/python -m pytest $(SPREAD) -m "compared and not slow" $(COMPARED)

lint: lint-rust lint-python docs

lint-rust:
	cargo fmt --all --check
	cargo clippy --workspace --all-targets -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps

lint-python: $(VENV)/.test
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy python docs examples

docs: $(WHEEL) $(VENV)/.docs
	$(BIN)/python docs/build_site.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --config-file build/mkdocs.yml
	! grep -rE '<(script|link|img|iframe)[^>]* (src|href)="?https?:' build/site --include='*.html' # offline
	@echo "The site is in build/site: python3 -m http.server --directory build/site"

figures: $(WHEEL)
	$(BIN)/python docs/figures.py

# everything that the pages cite, and the tables of docs/performance.md
bench: $(WHEEL) $(VENV)/.bench
	-$(BIN)/python -m pip install --quiet --no-deps "norfair>=2.3" # asks for a NumPy that others refuse
	$(BIN)/python benches/performance.py --long

# instructions of the kernels, compared with benches/instructions.txt; `--record` writes that file
counts:
	$(PYTHON) benches/instructions.py

clean:
	rm -rf $(VENV) build dist target

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade "pip>=25.1" "maturin>=1.9,<2"

dist/.built: $(BIN)/python $(SOURCES)
	rm -rf dist
	$(BIN)/maturin build --quiet --release --out dist
	touch $@

$(WHEEL): dist/.built
	$(BIN)/python -m pip install --quiet --force-reinstall --no-deps dist/tertia-*.whl
	$(BIN)/python -m pip install --quiet "$$(ls dist/tertia-*.whl)[cli,geo,io,plot,report]"
	touch $@

$(VENV)/.test $(VENV)/.bench $(VENV)/.docs: $(VENV)/.%: pyproject.toml $(BIN)/python
	$(BIN)/python -m pip install --quiet --group $*
	touch $@
