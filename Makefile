# Everything a person or the CI runs. Needs Rust, Python 3.10 or later with venv, a C compiler and make; nothing else.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= out
FUZZ_SECONDS ?= 60
FUZZ_TARGETS := camera recording urdf dress diagnosis
# The build of the tests (optimised, see Cargo.toml) is the one that the wheel shares its crates with: so both packages are named in `test-rust`.
PROFILE ?= dev
# What is never imported need not be compiled: that takes longer than installing.
INSTALL := $(BIN)/python -m pip install -q --disable-pip-version-check --no-compile
WHEELS := target/wheels
# Tests start many processes: what one has compiled of the packages the next ones read.
unexport PYTHONDONTWRITEBYTECODE

# Threads of linear algebra wait for each other by spinning; the workers keep all cores at work without them.
ONE_THREAD := OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1

# Their files alone: reading all others takes each worker longer than these tests take.
REALTIME := $(shell grep -l "mark.realtime" tests/python/test_*.py)

SOURCES := $(shell find crates python -name '*.rs' -o -name '*.py' -o -name '*.pyi' -o -name '*.toml' -o -name '*.urdf' -o -name '*.yaml' -o -name '*.j2') \
  Cargo.toml Cargo.lock pyproject.toml README.md python/mirror_simulation/README.md

# The lowest of each dependency that can be solved together; as in pyproject.toml.
FLOORS := numpy==1.26.4 opencv-python-headless==4.11.0.86 pillow==10.4.0 simplejpeg==1.7.6 pyarrow==23.0.0 \
  matplotlib==3.8.4 typer==0.15.4 click==8.1.8

.PHONY: check docs sdist test-floors help demo format test test-rust test-python lint wheel bench clean fuzz audit sbom

help: ## this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

demo: $(VENV)/installed ## render the embedded robot before a mirror, detect, measure, report, all into ./out
	$(BIN)/mirror-posture demo --out $(OUT)

# Both at once, so that no core waits for the other's last test. The core is built for its tests first (cargo lets one build run at a time), all
# of its targets at once, while packages are installed; the wheel is built while these run.
test: ## all tests, and whether all sources are formatted
	$(MAKE) -j 2 test-rust test-python
	$(MAKE) format

check: lint test ## before a commit, and in the CI: the lints, then all tests

# The examples are a part of the tests: programs of their own would only be compiled a second time.
test-rust: ## the core's tests; needs no Python
	cargo test --locked -q -p mirror-core -p mirror-py --tests
	cargo test --locked -q -p mirror-core -p mirror-py --doc

# A third of a worker's time is waiting for processes: three keep two cores at work. They would all compile the same files at the same
# moment: one process does it before.
test-python: $(VENV)/installed-for-tests ## build and install the wheel, test it
	$(BIN)/python -m pytest -q --collect-only > $(VENV)/collected.txt || { cat $(VENV)/collected.txt; exit 1; }
	$(ONE_THREAD) $(BIN)/python -m pytest -q -n 3 --dist worksteal -m "not realtime"
	$(ONE_THREAD) $(BIN)/python -m pytest -q -n 4 --dist worksteal -m realtime $(REALTIME)

test-floors: $(VENV)/wheel ## detection and sessions with the oldest dependencies that can be solved (not a part of `make test`)
	$(PYTHON) -m venv $(VENV)-floors
	$(VENV)-floors/bin/python -m pip install -q --disable-pip-version-check $(WHEELS)/mirror_posture-*.whl $(FLOORS) pytest hypothesis
	$(VENV)-floors/bin/python -m pytest -q -p no:cacheprovider tests/python/test_detect_markers.py tests/python/test_detect_labels.py \
	  tests/python/test_detect_board.py tests/python/test_detect_charuco.py tests/python/test_session.py tests/python/test_session_refusals.py tests/python/test_session_write.py

format: $(VENV)/installed-for-tests ## whether all sources are formatted
	cargo fmt --all --check
	$(BIN)/ruff format --check -q python tests/python benches

lint: format ## formatting, lints, types and the links of the documentation, Rust and Python
	cargo clippy --locked -q --workspace --all-targets -- -D warnings
	cargo clippy --locked -q -p mirror-core --no-default-features -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --locked -q --no-deps -p mirror-core
	$(BIN)/ruff check python tests/python benches
	MYPYPATH=python $(BIN)/mypy

wheel: $(VENV)/tools ## the wheels that are given away: fully optimised, for Python 3.10 and later
	$(BIN)/maturin build --release --locked --out dist
	$(BIN)/python -m pip wheel -q --disable-pip-version-check --no-deps --wheel-dir dist ./python/mirror_lab ./python/mirror_simulation

sdist: $(VENV)/tools ## the source distribution; builds a wheel from it, installs that, and tests it
	rm -rf target/sdist
	$(BIN)/maturin sdist --out target/sdist
	mkdir -p dist target/sdist/unpacked
	tar xzf target/sdist/*.tar.gz -C target/sdist/unpacked --strip-components 1
	CARGO_TARGET_DIR=$(CURDIR)/target $(BIN)/maturin build -q --profile $(PROFILE) -m target/sdist/unpacked/crates/mirror-py/Cargo.toml --out target/sdist/wheel
	! diff Cargo.lock target/sdist/unpacked/Cargo.lock | grep '^>'
	$(PYTHON) -m venv target/sdist/venv
	target/sdist/venv/bin/python -m pip install -q --disable-pip-version-check target/sdist/wheel/*.whl pytest hypothesis
	cd target/sdist/unpacked && ../venv/bin/python -m pytest -q -p no:cacheprovider tests/python/test_wheel.py tests/python/test_session.py
	cp target/sdist/*.tar.gz dist/

DOCS_TOOLS := mkdocs-material==9.* "mkdocstrings[python]>=0.26"

docs: $(VENV)/installed ## the documentation's site, into ./site: pages, references of formats, Python and Rust
	$(BIN)/python -m pip install -q --disable-pip-version-check $(DOCS_TOOLS)
	RUSTDOCFLAGS="-D warnings" cargo doc --locked -q --no-deps -p mirror-core
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet
	cp -r target/doc site/rust

bench: ## throughput of the core; benches/README.md says what was measured
	cargo bench --locked

fuzz: $(VENV)/installed-for-tests ## every border, for FUZZ_SECONDS each (60): cargo-fuzz for the core's, tests/python/fuzz.py for Python's
	for target in $(FUZZ_TARGETS); do \
	  mkdir -p fuzz/corpus/$$target target/fuzz-corpus/$$target && \
	  RUSTC_BOOTSTRAP=1 cargo fuzz run --sanitizer none $$target target/fuzz-corpus/$$target fuzz/corpus/$$target fuzz/seeds -- \
	    -max_total_time=$(FUZZ_SECONDS) -timeout=10 -rss_limit_mb=2000 || exit 1; \
	done
	$(BIN)/python tests/python/fuzz.py --runs 1000000000 --seconds $(FUZZ_SECONDS) --seed $$(date +%s)

audit: $(VENV)/installed $(VENV)-audit/tools ## licences, sources and known faults of the dependencies (needs cargo-deny, cargo-audit; databases over the network)
	tests/audit.sh $(VENV) $(VENV)-audit

sbom: $(VENV)/installed $(VENV)-audit/tools ## what is in the crates and in an installed environment, as CycloneDX, into ./dist (needs cargo-cyclonedx)
	mkdir -p dist
	cargo cyclonedx --format json --spec-version 1.5 --no-build-deps
	mv crates/mirror-core/mirror-core.cdx.json crates/mirror-py/mirror-py.cdx.json dist/
	$(VENV)-audit/bin/cyclonedx-py environment --output-reproducible --spec-version 1.5 --output-format JSON --output-file dist/python.cdx.json $(BIN)/python

clean: ## remove what was built; the cargo cache stays
	rm -rf $(VENV) $(VENV)-floors $(VENV)-audit $(WHEELS) $(OUT) dist site docs/reference target/sdist

$(VENV)-audit/tools: Makefile
	$(PYTHON) -m venv $(VENV)-audit
	$(VENV)-audit/bin/python -m pip install -q --disable-pip-version-check "pip-audit>=2.7,<3" "cyclonedx-bom>=6,<8"
	touch $@

$(VENV)/tools: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -q --disable-pip-version-check "maturin>=1.9,<2"
	touch $@

$(VENV)/wheel: $(VENV)/tools $(SOURCES)
	rm -rf $(WHEELS)
	$(BIN)/maturin build -q --profile $(PROFILE) --locked --out $(WHEELS)
	$(BIN)/python -m pip wheel -q --disable-pip-version-check --no-deps --wheel-dir $(WHEELS) ./python/mirror_lab ./python/mirror_simulation
	touch $@

# Installed as a user installs it, with its dependencies and the distribution mirror-posture-lab; the sources are not
# on the path. The second command replaces older wheels of the same version, and adds mirror-posture-simulation without MuJoCo.
$(VENV)/installed: $(VENV)/wheel
	$(INSTALL) $(WHEELS)/mirror_posture-*.whl $(WHEELS)/mirror_posture_lab-*.whl
	$(INSTALL) --no-deps --force-reinstall $(WHEELS)/*.whl
	touch $@

# What comes from elsewhere is there before the wheel is: cargo compiles the core's tests first, and pip mostly waits for the network.
$(VENV)/dependencies: pyproject.toml tests/dependencies.py $(VENV)/tools
	$(BIN)/python tests/dependencies.py test > $(VENV)/dependencies.txt
	$(INSTALL) -r $(VENV)/dependencies.txt
	touch $@

$(VENV)/installed-for-tests: $(VENV)/dependencies $(VENV)/installed
	$(INSTALL) --find-links $(WHEELS) "$$(ls $(WHEELS)/mirror_posture-*.whl)[test]"
	touch $@
