# Every target builds what it needs: python3 with venv is all that must be installed.
PYTHON ?= python3
VENV ?= .venv
WORKERS ?= 2
# The quality benchmark: PARC's interpreter, built if it is not there, and the folder of the runs.
PARC ?= build/parc/bin/python
QUALITY ?= output/quality
# The environment of the lower bounds, and the oldest Python that pyproject.toml allows.
OLDEST ?= build/oldest
OLDEST_PYTHON ?= python3.11
# What a user gets, asked from outside for known vulnerabilities and for what it consists of.
AUDITED ?= build/audited
AUDIT ?= build/audit
# 0 leaves the examples out of the pages: the tests run them, too.
GALLERY ?= 1
BIN := $(VENV)/bin

# Solvers and workers share the cores: one BLAS thread each is faster than two that fight.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
export MPLBACKEND ?= Agg

.PHONY: help demo test nightly mutations test-kernels test-oldest audit lint examples examples-record docs docs-offline bench bench-seeding bench-quality \
	bench-undeclared bench-measured bench-speed bench-peers bench-trajectories bench-automata golden golden-quick \
	figures clean

help:
	@echo "make demo      identify the built-in example and draw it"
	@echo "make test      run the tests, warnings as errors"
	@echo "make nightly   the longest tests, an hour together, and the pages with all examples"
	@echo "make mutations  do the tests notice 63 small changes of the code? (an hour; resumes)"
	@echo "make test-kernels  the deciding tests and all examples under every kernel of OpenBLAS (hours)"
	@echo "make golden    answers of today beside those frozen before the engine was rebuilt (half an hour)"
	@echo "make golden-quick  a part of them, in five minutes"
	@echo "make test-oldest   the tests with the lower bounds of every dependency"
	@echo "make audit     known vulnerabilities of what is installed, and a bill of materials (network)"
	@echo "make lint      ruff and mypy"
	@echo "make examples  run every example, headless, and compare what it prints"
	@echo "make examples-record  keep what every example prints now as the expected output"
	@echo "make docs      build the documentation, warnings as errors"
	@echo "make docs-offline  the same without measured data and without network"
	@echo "make bench     the paper's figures and tables beside ours, into the documentation"
	@echo "make bench-seeding  what the start decides, into the documentation (20 minutes)"
	@echo "make bench-quality  many systems and methods, into the documentation (hours)"
	@echo "make bench-undeclared  planted effects: every kind, system and seed (hours; resumes)"
	@echo "make bench-measured  measured data, before and after"
	@echo "make bench-trajectories  noisy recordings without velocities, beside what they allow (hours; resumes)"
	@echo "make bench-automata  hybrid automata of the literature, clean and with noise (an hour; resumes)"
	@echo "make bench-speed     structured solvers and whole fits, in ratios"
	@echo "make bench-peers     recordings, beside CasADi with IPOPT and dynamax (minutes)"
	@echo "make figures   draw the figures of README and pages, write what commands print into them"


demo: $(VENV)/.installed-plot
	$(BIN)/python -m swsysid --output output
	@echo "Picture, text and model: output/phase_portrait.png, identification.txt, model.json"

test: $(VENV)/.installed-test
	$(BIN)/python -m pytest -n $(WORKERS)

nightly: $(VENV)/.installed-test
	$(BIN)/python -m pytest -n $(WORKERS) -m nightly
	$(MAKE) docs-offline

mutations: $(VENV)/.installed-test $(VENV)/.installed-mutation
	$(BIN)/python -m benchmarks.mutations

# No answer may depend on the processor: five kernels of OpenBLAS, those that run here.
test-kernels: $(VENV)/.installed-test
	PYTEST_ADDOPTS="-n $(WORKERS)" $(BIN)/python tests/helpers/kernels.py

test-oldest: $(OLDEST)/.installed
	$(OLDEST)/bin/python -m pytest -n $(WORKERS)

# A package that the index knows nothing of fails it, too: what was not asked is not clean.
audit:
	test -x $(AUDITED)/bin/python || $(PYTHON) -m venv $(AUDITED)
	$(AUDITED)/bin/python -m pip install --quiet --disable-pip-version-check --upgrade pip setuptools .
	test -x $(AUDIT)/bin/python || $(PYTHON) -m venv $(AUDIT)
	$(AUDIT)/bin/python -m pip install --quiet --disable-pip-version-check pip-audit cyclonedx-bom
	$(AUDIT)/bin/cyclonedx-py environment --output-reproducible --pyproject pyproject.toml \
		--output-file build/sbom.json $(AUDITED)/bin/python
	@echo "Bill of materials: build/sbom.json (CycloneDX)"
	$(AUDITED)/bin/python -m pip uninstall --quiet --yes swsysid
	$(AUDIT)/bin/pip-audit --strict --progress-spinner off \
		--path "$$($(AUDITED)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')"

golden: $(VENV)/.installed-bench
	$(BIN)/python -W ignore -m benchmarks.golden --jobs $(WORKERS) --compare benchmarks/golden/frozen

golden-quick: $(VENV)/.installed-bench
	$(BIN)/python -W ignore -m benchmarks.golden --part quick $(GOLDEN) --jobs $(WORKERS) \
		--compare benchmarks/golden/frozen

$(OLDEST)/.installed: pyproject.toml tests/helpers/lower_bounds.py
	test -x $(OLDEST)/bin/python || $(OLDEST_PYTHON) -m venv $(OLDEST)
	$(OLDEST)/bin/python tests/helpers/lower_bounds.py > $(OLDEST)/constraints.txt
	$(OLDEST)/bin/python -m pip install --quiet --disable-pip-version-check \
		--constraint $(OLDEST)/constraints.txt -e ".[test,parquet]"
	touch $@

lint: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

examples: $(VENV)/.installed-test
	$(BIN)/python -m pytest tests/docs/test_examples.py

# Sphinx may end early with status 0, as when an example leaves the interpreter: a build that wrote
# no front page has failed.
docs: $(VENV)/.installed-docs
	rm -f docs/_build/html/index.html
	$(BIN)/python -m sphinx -q -W --keep-going -b html -D plot_gallery=$(GALLERY) \
		docs docs/_build/html
	@test -f docs/_build/html/index.html || { echo "Sphinx ended without a front page."; exit 1; }
	@echo "Open docs/_build/html/index.html ."

# The same without measured data and without network, as a reader on a train builds them.
docs-offline: $(VENV)/.installed-docs
	env -u SWSYSID_DATA XDG_CACHE_HOME=$(CURDIR)/docs/_build/no_cache \
		http_proxy=http://127.0.0.1:9 https_proxy=http://127.0.0.1:9 $(MAKE) docs

examples-record: $(VENV)/.installed-test
	$(BIN)/python tests/helpers/example_output.py

bench: $(VENV)/.installed-bench
	$(BIN)/python -W ignore -m benchmarks.paper --docs docs
	$(BIN)/python -m benchmarks.paper.algorithm --docs docs

bench-seeding: $(VENV)/.installed-bench
	$(BIN)/python -m benchmarks.seeding --jobs $(WORKERS) --docs docs

bench-quality: $(VENV)/.installed-bench $(PARC)
	$(BIN)/python -W ignore -m benchmarks.quality --jobs $(WORKERS) --parc $(PARC) \
		--stress --count --scaling --timing --output $(QUALITY) --docs docs

bench-undeclared: $(VENV)/.installed-bench
	$(BIN)/python -W ignore -m benchmarks.undeclared --jobs $(WORKERS) --docs docs

bench-measured: $(VENV)/.installed-bench
	$(BIN)/python -W ignore -m benchmarks.measured --docs docs

bench-trajectories: $(VENV)/.installed-bench
	$(BIN)/python -W ignore -m benchmarks.trajectories --jobs $(WORKERS) --docs docs

bench-automata: $(VENV)/.installed-bench
	$(BIN)/python -W ignore -m benchmarks.automata --jobs $(WORKERS) --docs docs

bench-speed: $(VENV)/.installed-bench $(PARC)
	OMP_NUM_THREADS=1 $(BIN)/python -W ignore -m benchmarks.speed --parc $(PARC) --docs docs

bench-peers: $(VENV)/.installed-bench $(VENV)/.installed-peers
	OMP_NUM_THREADS=1 $(BIN)/python -m benchmarks.speed.peers --docs docs

$(PARC):
	PYTHON=$(PYTHON) benchmarks/parc/build.sh $(PARC:/bin/python=)

figures: $(VENV)/.installed-plot
	$(BIN)/python docs/readme_figure.py
	$(BIN)/python docs/choice_chart.py
	$(BIN)/python docs/architecture.py
	$(BIN)/python docs/printed_runs.py --write

# One stamp for each extra: it is made again when pyproject.toml changes.
$(VENV)/.installed-%: pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[$*]"
	touch $@

clean:
	rm -rf $(VENV) docs/_build docs/auto_examples docs/generated output
