# make demo   the whole story on shipped logs; sets up .venv with what it needs
# make test   the tests, less the slow ones; sets up .venv with every extra
# make lint   ruff and pyright
# make slow   the slow tests
# make fuzz   mutated files for every reader, FUZZ_SECONDS long (600); faults go to fuzz_failures/
# make figures  draws the README's pictures anew
# make clean  removes .venv and everything generated
#
# PYTHON=python3.12 make test   uses another interpreter (3.11 or newer).

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Without --no-compile pip spends half of its time on modules that nobody imports.
PIP := PYTHONWARNINGS=ignore PIP_ROOT_USER_ACTION=ignore PIP_DISABLE_PIP_VERSION_CHECK=1 \
       $(BIN)/python -m pip install -qq --no-input --no-compile -c constraints.txt

# One stamp for each set of extras; the full set contains the demo's.
DEMO_READY := $(VENV)/.ready-demo
ALL_READY := $(VENV)/.ready-all

.PHONY: demo test lint slow fuzz figures clean

demo: $(DEMO_READY)
	$(BIN)/youbot demo

test: $(ALL_READY)
	$(BIN)/python -m pytest -n 2

lint: $(ALL_READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

slow: $(ALL_READY)
	$(BIN)/python -m pytest -m slow

# Half of the time mutations that know the formats, half those that atheris chooses by the code that
# they reach. Atheris has no wheels for every Python: without it all of the time is the former's.
FUZZ_SECONDS ?= 600
FUZZ_SEED ?= 0
fuzz: $(ALL_READY)
	-@$(PIP) -e '.[fuzz]' 2>/dev/null
	$(BIN)/python -m tests.fuzz --seconds $$(($(FUZZ_SECONDS) / 2)) --seed $(FUZZ_SEED)
	$(BIN)/python -m tests.fuzz --seconds $$(($(FUZZ_SECONDS) / 2)) --seed $(FUZZ_SEED) --guided

figures: $(ALL_READY)
	$(BIN)/youbot demo --output demo_output
	mkdir -p docs/figures
	cp demo_output/plots/free_run_multisine_b.png demo_output/plots/error_by_model.png docs/figures/
	$(BIN)/youbot evaluate --plots demo_output/evaluate
	cp demo_output/evaluate/error_by_frequency.png docs/figures/

clean:
	rm -rf $(VENV) build dist *.egg-info demo_output
	rm -rf .pytest_cache .ruff_cache .hypothesis fuzz_failures
	find youbot_env identification controllers scripts tests -name __pycache__ -prune -exec rm -rf {} +

# The order matters: pip's success is what the stamp stands for, and a failed set-up leaves none.
$(DEMO_READY): pyproject.toml constraints.txt | $(VENV)/.created
	@echo "Setting up $(VENV) for the demo (once, about a minute) ..."
	@$(PIP) -e '.[plots,render]'
	@touch $@

$(ALL_READY): pyproject.toml constraints.txt | $(VENV)/.created
	@echo "Setting up $(VENV) with every extra (once, a few minutes) ..."
	@$(PIP) -e '.[all,dev]'
	@touch $(DEMO_READY) $@

# An environment whose interpreter has gone is made anew; any other is kept.
$(VENV)/.created:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	  echo "youbot needs Python 3.11 or newer; '$(PYTHON)' is missing or older." >&2; \
	  echo "Name another one: make $(MAKECMDGOALS) PYTHON=python3.12" >&2; exit 1; }
	@$(BIN)/python -c '' 2>/dev/null && clear= || clear=--clear; \
	$(PYTHON) -m venv $$clear $(VENV) || { \
	  echo "Could not make $(VENV); on Debian and Ubuntu: apt install python3-venv" >&2; exit 1; }
	@touch $@
