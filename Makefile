# make demo   the whole story on shipped logs; sets up .venv with what it needs
# make test   the tests, less the slow ones; sets up .venv with every extra
# make lint   ruff and pyright
# make slow   the slow tests
# make fuzz   mutated files for every reader, FUZZ_SECONDS long (600); faults go to fuzz_failures/
# make docs   the documentation site, in site/
# make figures  draws the pictures of README and site anew
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

.PHONY: demo test lint slow fuzz docs figures clean

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

docs: $(ALL_READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet
	@echo "The site: $(CURDIR)/site/index.html"
	@echo "Its search needs a server: $(BIN)/python -m http.server -d site"

DEMO := demo_output
figures: $(ALL_READY)
	$(BIN)/youbot demo --output $(DEMO)
	mkdir -p docs/figures
	cp $(addprefix $(DEMO)/plots/,free_run_multisine_b.png error_by_model.png tracking_multisine_b.png \
	  motion_calibration.png estimates.png forces_calibration.png) docs/figures/
	$(BIN)/youbot evaluate --plots $(DEMO)/evaluate
	cp $(DEMO)/evaluate/error_by_frequency.png docs/figures/
	$(BIN)/youbot record $(DEMO)/drags/ --effect uneven_wheel_friction:extra_bl=0.05 --rate 50 --seed 5 \
	  --motions calibration,multisine_a,multisine_b
	$(BIN)/youbot identify $(DEMO)/drags/calibration.csv -o $(DEMO)/drags.json
	$(BIN)/youbot compare $(DEMO)/drags.json $(DEMO)/drags/multisine_b.csv --plots $(DEMO)/before
	$(BIN)/youbot diagnose $(DEMO)/drags.json $(DEMO)/drags/calibration.csv $(DEMO)/drags/multisine_a.csv \
	  -o $(DEMO)/mended.json --plots $(DEMO)/why
	$(BIN)/youbot compare $(DEMO)/mended.json $(DEMO)/drags/multisine_b.csv --plots $(DEMO)/after
	cp $(DEMO)/why/errors.png docs/figures/misfit_errors.png
	cp $(DEMO)/before/residual.png docs/figures/misfit_residual.png
	cp $(DEMO)/before/free_run_multisine_b.png docs/figures/misfit_free_run_before.png
	cp $(DEMO)/after/free_run_multisine_b.png docs/figures/misfit_free_run_after.png
	$(BIN)/youbot watch --controllers kinematic,computed_torque --seconds 8 --fps 8 --height 240 \
	  -o docs/figures/watch.gif


clean:
	rm -rf $(VENV) build dist *.egg-info demo_output site
	rm -rf .pytest_cache .ruff_cache .hypothesis fuzz_failures
	find youbot_env identification controllers scripts tests -name __pycache__ -prune -exec rm -rf {} +

# The order matters: pip's success is what the stamp stands for, and a failed set-up leaves none.
$(DEMO_READY): pyproject.toml constraints.txt | $(VENV)/.created
	@echo "Setting up $(VENV) for the demo (once, about a minute) ..."
	@$(PIP) -e '.[plots,render]'
	@touch $@

$(ALL_READY): pyproject.toml constraints.txt | $(VENV)/.created
	@echo "Setting up $(VENV) with every extra (once, a few minutes) ..."
	@$(PIP) -e '.[all,dev,docs]'
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
