# make run, make test: either sets up .venv first, the latter with the tools of development as well.
# ARGS are passed on: make test ARGS="-k store".
ENV   := .venv
BIN   := $(ENV)/bin
STAMP := $(ENV)/.ready
TOOLS := $(ENV)/.tools
DOCS  := $(ENV)/.docs
UV    ?= uv

# Running needs a quarter of the packages' bytecode: the first import writes it, whatever the environment says.
unexport PYTHONDONTWRITEBYTECODE
PIP_INSTALL := install --quiet --quiet --no-compile
export PIP_DISABLE_PIP_VERSION_CHECK=1
export PIP_NO_INPUT=1
export PIP_ROOT_USER_ACTION=ignore

# Without PYTHON=..., the first of these that is new enough.
CANDIDATES := $(or $(PYTHON),python3 python3.13 python3.12 python3.11)
RECENT     := import sys; sys.exit(sys.version_info < (3, 11))

.PHONY: run test test-all coverage endurance check format bench docs docs-figures wheel lock clean
.DEFAULT_GOAL := run
.NOTPARALLEL:  # make -j run test: both would set up one environment

# A copied checkout, or one whose Python is gone, must not go on with the old environment.
ifneq ($(shell $(BIN)/python -c "print(open('$(STAMP)').read())" 2>/dev/null),$(CURDIR))
$(shell rm -f $(STAMP))
endif

run: $(STAMP)
	@$(BIN)/python -m fraexp run paper/fig12 $(ARGS)

# What a change must pass, in minutes; and the whole suite, of which that is a part, the kernel's ratios to C with room
# for a machine that has other work to do.
test: check
	@$(BIN)/python -m pytest -n auto --dist worksteal $(ARGS)

test-all: check $(DOCS)
	@$(BIN)/python benchmarks/kernel.py --reduced --slack 1.5
	@$(BIN)/python -m pytest -n auto --dist worksteal -m "" --hypothesis-profile thorough $(ARGS)

# Lines and branches that either suite runs; and how often and in which time `make test` passes beside other work.
coverage: $(DOCS)
	@$(BIN)/python benchmarks/suite.py coverage $(ARGS)

endurance: check
	@$(BIN)/python benchmarks/suite.py endurance $(ARGS)

# On a busy machine mypy's workers may start too late for it: an exit code other than 1, which types have.
check: $(TOOLS)
	@$(BIN)/ruff format --quiet --check . || { echo "not formatted: run make format" >&2; exit 1; }
	@$(BIN)/ruff check --quiet .
	@$(BIN)/python -m mypy --num-workers auto --no-error-summary || \
	  { test $$? -ne 1 && $(BIN)/python -m mypy --no-error-summary; }
	@$(BIN)/lint-imports --no-logo > $(ENV)/imports.log || { cat $(ENV)/imports.log >&2; exit 1; }

format: $(TOOLS)
	@$(BIN)/ruff format --quiet .
	@$(BIN)/ruff check --quiet --fix .

# Each prints a table and fails where a bound is missed; all are run. The peers are those that are installed.
BENCHMARKS := accuracy band_coverage friction_bands plant_fit friction_identification positioning autonomous \
              maximum_likelihood law_selection excitation_design random_machines wrong_friction hostile_laws limits \
              autonomous_measurement measurements tuned_loops kernel contacts peer_table scaling monte_carlo timing \
              store flipped_bits terminal tui
# These disturb runs, for hours at full size.
DISTURBANCES := long_draws torture dask_torture

bench: $(TOOLS)
	@failed=; for command in $(BENCHMARKS:%=%.py) $(DISTURBANCES:%="%.py --quick"); do \
	  echo; echo "== benchmarks/$$command"; \
	  $(BIN)/python benchmarks/$$command $(ARGS) || failed="$$failed $${command%%.py*}"; done; \
	if test -n "$$failed"; then echo "missed a bound:$$failed" >&2; exit 1; fi

# Into build/site, without network. The variables silence advertisements: of the theme, for the successor of MkDocs by
# its makers, and of a package that some plugins of MkDocs bring, for itself.
docs: $(DOCS)
	@NO_MKDOCS_2_WARNING=1 DISABLE_MKDOCS_2_WARNING=true \
	  $(BIN)/python -m mkdocs build --strict --config-file docs/site/mkdocs.yml $(ARGS)
	@echo build/site/index.html

docs-figures: $(TOOLS)
	@$(BIN)/python -m fraexp run paper/fig12 $(ARGS)
	@cp figures/paper/fig12.png docs/figures/fig12.png
	@$(BIN)/python docs/make_screens.py

wheel: $(TOOLS)
	@$(BIN)/hatchling build --target wheel

# All is resolved at once; developing needs a part of it, and running a part of that: all locks pin the same versions.
COMPILE := pip compile pyproject.toml --universal --python-version 3.11 --fork-strategy fewest --generate-hashes \
           --no-emit-index-url --no-annotate --no-header --quiet

lock:
	@command -v $(UV) > /dev/null || { echo "make lock: uv not found; install it, for example with pip install uv" >&2; exit 1; }
	@$(UV) $(COMPILE) --group docs $(ARGS) --output-file requirements-docs.lock
	@$(UV) $(COMPILE) --group dev --constraint requirements-docs.lock --output-file requirements-dev.lock
	@$(UV) $(COMPILE) --group build --constraint requirements-dev.lock --output-file requirements.lock

clean:
	rm -rf $(ENV) build dist .pytest_cache .hypothesis .mypy_cache .ruff_cache .import_linter_cache
	find fraexp plugins tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +

# A stamp is written last: a set-up that was interrupted starts afresh, one that is out of date is brought up to date.
$(STAMP): pyproject.toml requirements.lock
	@set -e; \
	for candidate in $(CANDIDATES); do \
	  if $$candidate -c '$(RECENT)' 2> /dev/null; then python=$$candidate; break; fi; \
	done; \
	test -n "$$python" || { echo "fraexp needs Python 3.11 or newer; found none as: $(CANDIDATES) (set PYTHON=...)" >&2; exit 1; }; \
	if test -e $@; then echo "bringing $(ENV) up to date" >&2; \
	else echo "setting up $(ENV) with $$($$python --version), once: about a minute" >&2; rm -rf $(ENV); fi; \
	rm -f $@; \
	test -x $(BIN)/python || $$python -m venv $(ENV) > /dev/null 2>&1 || $$python -m venv --clear --without-pip $(ENV); \
	pip="$(BIN)/python -m pip"; \
	$$pip --version > /dev/null 2>&1 || pip="$$python -m pip --python $(BIN)/python"; \
	$$pip --version > /dev/null 2>&1 || { echo "$$python has no pip; install it (Debian: python3-pip or python3-venv)" >&2; exit 1; }; \
	$$pip $(PIP_INSTALL) --require-hashes --requirement requirements.lock; \
	$$pip $(PIP_INSTALL) --no-deps --no-build-isolation --editable .; \
	printf %s "$$pip" > $(ENV)/.pip; \
	printf %s "$(CURDIR)" > $@

# Meanwhile the stamp is away: an interruption leaves what is half installed, a failure (no network) does not.
define ADD
	@echo "adding $(1) to $(ENV), once: about a minute" >&2
	@set -e; \
	mv $(STAMP) $(STAMP).kept; \
	$$(cat $(ENV)/.pip) $(PIP_INSTALL) --require-hashes --requirement $(2) || \
	  { mv $(STAMP).kept $(STAMP); exit 1; }; \
	mv $(STAMP).kept $(STAMP); \
	touch $@
endef

$(TOOLS): $(STAMP) requirements-dev.lock
	$(call ADD,the tools of development,requirements-dev.lock)

# The site and the notebooks.
$(DOCS): $(TOOLS) requirements-docs.lock
	$(call ADD,what documentation needs,requirements-docs.lock)
