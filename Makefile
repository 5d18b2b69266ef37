# `make run` reproduces the paper, `make test` runs the tests; both set themselves up first.
# Recipes speak of paths relative to this folder, so that its name may hold spaces.

VENV := .venv
PY := $(VENV)/bin/python
# Files of tests on all cores, but not on so many that memory runs short.
SIDE_BY_SIDE := -n auto --maxprocesses 4 --dist loadfile

.PHONY: run test test-all check format bench bench-quick studies audit-studies interval-studies results reference-studies strategy-studies fuzz faults kills mutants rig-demo lock clean help

run: $(VENV)/.ready-run
	@$(VENV)/bin/solidtouch reproduce

test: $(VENV)/.ready-dev
	@$(PY) -m pytest -m "not slow" $(SIDE_BY_SIDE)

test-all: $(VENV)/.ready-dev
	@$(PY) -m pytest

check: $(VENV)/.ready-dev
	@$(PY) -m ruff check .
	@$(PY) -m ruff format --check .
	@$(PY) -m pyright
	@# import-linter reads packages as they are installed, not as they are mapped from folders.
	@rm -rf build/imports && mkdir -p build/imports && cp -R solidtouch build/imports/
	@cp -R models hardware inference analysis cli build/imports/solidtouch/
	@cd build/imports && ../../$(VENV)/bin/lint-imports --config ../../pyproject.toml

format: $(VENV)/.ready-dev
	@$(PY) -m ruff check --fix .
	@$(PY) -m ruff format .

bench: $(VENV)/.ready-dev
	@$(PY) benchmarks/run.py --document docs/performance.md

bench-quick: $(VENV)/.ready-dev
	@$(PY) benchmarks/run.py --quick

studies: $(VENV)/.ready-run
	@$(PY) benchmarks/recovery.py --document docs/model-studies.md
	@$(PY) benchmarks/sbc.py --document docs/model-studies.md
	@$(PY) benchmarks/sessions.py --document docs/model-studies.md

audit-studies: $(VENV)/.ready-run
	@$(PY) benchmarks/audit_levels.py --document docs/audit-studies.md
	@$(PY) benchmarks/audit_drift.py --document docs/audit-studies.md
	@$(PY) benchmarks/audit_causes.py --document docs/audit-studies.md
	@$(PY) benchmarks/audit_guarantees.py --document docs/audit-studies.md
	@$(PY) benchmarks/audit_target.py --document docs/audit-studies.md
	@$(PY) benchmarks/audit_sets.py --document docs/audit.md $(if $(RECORDED),--recorded "$(RECORDED)")

interval-studies: $(VENV)/.ready-run
	@$(PY) benchmarks/calibration_level.py --document docs/intervals.md
	@$(PY) benchmarks/exponent_level.py --document docs/intervals.md
	@$(PY) benchmarks/intervals.py --document docs/intervals.md
	@$(PY) benchmarks/stored_taps.py --document docs/intervals.md
	@$(PY) benchmarks/intervals_commands.py --document docs/intervals-commands.md

results: $(VENV)/.ready-run
	@$(PY) benchmarks/results.py --document docs/results.md $(if $(RECORDED),--recorded "$(RECORDED)")
	@$(PY) benchmarks/comparison.py --document docs/comparison.md $(if $(RECORDED),--recorded "$(RECORDED)")
	@$(PY) benchmarks/holes.py --document docs/results.md $(if $(RECORDED),--recorded "$(RECORDED)")

reference-studies: $(VENV)/.ready-run
	@$(PY) benchmarks/chain.py --document docs/calibration.md
	@$(PY) benchmarks/open_choices.py --document docs/open-choices.md $(if $(RECORDED),--recorded "$(RECORDED)")
	@$(PY) benchmarks/unknown.py --document docs/unknown-objects.md

strategy-studies: $(VENV)/.ready-run
	@$(PY) benchmarks/strategies.py --document docs/strategies.md
	@$(PY) benchmarks/tuning.py --document docs/tuning.md

fuzz: $(VENV)/.ready-run
	@$(PY) benchmarks/fuzz.py

faults: $(VENV)/.ready-run
	@$(PY) benchmarks/faults.py

kills: $(VENV)/.ready-run
	@$(PY) benchmarks/kills.py

mutants: $(VENV)/.ready-dev
	@$(PY) benchmarks/mutants.py --document docs/mutants.md $(if $(NUMBER),--number $(NUMBER))

rig-demo: $(VENV)/.ready-run
	@PATH="$(CURDIR)/$(VENV)/bin:$$PATH" docs/examples/rig-demo.sh

# Pins every dependency for Python 3.12 to 3.14, on every platform, without addresses.
lock: $(VENV)/.ready-dev
	@$(PY) -m uv pip compile pyproject.toml --group dev --universal --python-version 3.12 --upgrade --quiet \
		--no-header --no-annotate --output-file constraints.txt

clean:
	rm -rf $(VENV) build dist *.egg-info

help:
	@echo "make run     reproduce the paper, about a minute"
	@echo "make test    the tests, without the slow ones; the first run compiles what the next ones find in build/xla"
	@echo "make test-all  all tests, with whole commands, clusters and emulated rigs that take long"
	@echo "make check   lint, format, types and import layers"
	@echo "make format  mend lint and format"
	@echo "make bench   time everything beside baselines and limits, into docs/performance.md; bench-quick only tries it"
	@echo "make studies whether models are recognised, fits calibrated, and what sessions gain, into docs/model-studies.md"
	@echo "make audit-studies  level and power of the audit, and whether its promises hold, into docs/audit-studies.md"
	@echo "make interval-studies  coverage of intervals and level of the verdict on beliefs, into docs/intervals.md; hours"
	@echo "make results  what the software finds on simulated taps, with RECORDED=FOLDER on recorded ones too, into docs"
	@echo "make reference-studies  calibration of the whole chain, each open choice of the paper, level and power of unknown"
	@echo "make strategy-studies  how to move and when to stop: strategies, regret against the exact rule, tuning"
	@echo "make rig-demo  emulated devices: collect, fit and perceive over serial ports"
	@echo "make faults  random faults of the emulated rig, and what came of them"
	@echo "make kills   kill a data collection at random moments, and what was lost"
	@echo "make mutants  plant small errors and count those that tests notice, into docs/mutants.md; takes hours, resumes"
	@echo "make fuzz    a million random and mutated inputs for the decoders"
	@echo "make lock    choose the newest dependencies and pin them in constraints.txt"
	@echo "make clean   remove what the others made"

$(VENV)/.ready-run: pyproject.toml constraints.txt
	@./.ci/make-venv $(VENV)
	@echo "Installing solidtouch into $(VENV) ..."
	@./.ci/quietly $(PY) -m pip install --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(VENV)/.ready-dev: $(VENV)/.ready-run
	@echo "Installing what the tests need into $(VENV) ..."
	@./.ci/quietly $(PY) -m pip install --disable-pip-version-check -c constraints.txt --group dev
	@touch $@
