# `make run` reproduces the paper, `make test` runs the tests; both set themselves up first.
# Recipes speak of paths relative to this folder, so that its name may hold spaces.

VENV := .venv
PY := $(VENV)/bin/python
# docker or podman.
CONTAINERS := docker
# Files of tests on all cores, but not on so many that memory runs short, in the order of tests/conftest.py.
SIDE_BY_SIDE := -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder

.PHONY: docs docs-check man setup run test test-times test-all test-lowest test-newest dist dist-check sdist-test wheel-test container container-test check format bench bench-cluster bench-quick studies audit-studies interval-studies results reference-studies posteriors strategy-studies fuzz faults firmware kills mutants house peers wheel-validate rig-demo citation lock clean help

setup: $(VENV)/.ready-dev

run: $(VENV)/.ready-run
	@$(VENV)/bin/solidtouch reproduce

test: $(VENV)/.ready-dev
	@$(PY) -m pytest -m "not slow" $(SIDE_BY_SIDE) $(TESTS)

test-times: $(VENV)/.ready-dev
	@$(PY) -m pytest -m "not slow" --durations=20 --durations-min=0 $(SIDE_BY_SIDE)

test-all: $(VENV)/.ready-dev
	@$(PY) -m pytest $(SIDE_BY_SIDE)

dist: $(VENV)/.ready-dist
	@rm -rf build/lib build/bdist.* dist
	@$(PY) -m build --outdir dist . >/dev/null

# The source distribution holds every file of the repository, and no other but what setuptools writes.
dist-check: dist
	@$(PY) -m twine check --strict dist/*
	@$(PY) -m check_wheel_contents dist/*.whl
	@mkdir -p build && git ls-files | sort > build/tracked
	@tar -tf dist/*.tar.gz | grep -v '/$$' | cut -d/ -f2- | sort > build/packed
	@comm -23 build/tracked build/packed | sed 's/^/not packed: /' > build/packing
	@comm -13 build/tracked build/packed | grep -vE '^(PKG-INFO|setup\.cfg|solidtouch\.egg-info/.*)$$' | sed 's/^/not tracked: /' >> build/packing
	@! grep . build/packing

# The default tests in the unpacked source distribution, in an environment of its own; TESTS= as above.
sdist-test: dist
	@rm -rf build/sdist && mkdir -p build/sdist && tar -xf dist/*.tar.gz -C build/sdist --strip-components 1
	@$(MAKE) -C build/sdist test TESTS="$(TESTS)"

wheel-test:
	@rm -rf build/wheel-test
	@./.ci/try-wheel build/wheel-test

container:
	$(CONTAINERS) build --file packaging/Dockerfile --tag solidtouch .

# The recipe of the conformance kit, too, which checks the example in Python.
container-test: container dist
	$(CONTAINERS) run --rm solidtouch validate
	@rm -rf build/kit-image && mkdir -p build/kit-image
	@cp dist/*.whl docs/reference/conformance/Containerfile docs/reference/conformance/solid.py build/kit-image
	$(CONTAINERS) build --file build/kit-image/Containerfile --tag conformance build/kit-image
	$(CONTAINERS) run --rm --volume "$(CURDIR)/build/kit-image:/work" conformance check --command "python solid.py"

# With the oldest direct dependencies that pyproject.toml allows and with the newest; TESTS= chooses files and folders.
test-lowest test-newest: $(VENV)/.ready-dev
	@$(PY) -m uv venv --quiet --clear --python $(or $(PYTHON),3.12) build/$@
	@$(PY) -m uv pip install --quiet --python build/$@ --resolution $(if $(findstring lowest,$@),lowest-direct,highest) \
		-e '.[all]' --group dev
	@build/$@/bin/python -m pytest -m "not slow" $(SIDE_BY_SIDE) $(TESTS)

check: $(VENV)/.ready-dev
	@$(PY) -m ruff check .
	@$(PY) -m ruff format --check .
	@$(PY) -m pyright --threads
	@# import-linter reads packages as they are installed, not as they are mapped from folders.
	@rm -rf build/imports && mkdir -p build/imports && cp -R solidtouch build/imports/
	@cp -R models hardware inference analysis cli build/imports/solidtouch/
	@cd build/imports && ../../$(VENV)/bin/lint-imports --config ../../pyproject.toml

format: $(VENV)/.ready-dev
	@$(PY) -m ruff check --fix .
	@$(PY) -m ruff format .

bench: $(VENV)/.ready-dev
	@$(PY) -m benchmarks.speed.run --document docs/reference/performance.md
	@$(PY) -m benchmarks.speed.commands.run --document docs/reference/performance.md $(if $(BEFORE),--before "$(BEFORE)")
	@$(PY) -m benchmarks.speed.growth --document docs/reference/performance.md

bench-cluster: $(VENV)/.ready-dev
	@$(PY) -m benchmarks.speed.cluster --document docs/how-to/cluster.md

bench-quick: $(VENV)/.ready-dev
	@$(PY) -m benchmarks.speed.run --quick
	@$(PY) -m benchmarks.speed.commands.run --quick
	@$(PY) -m benchmarks.speed.growth --quick

studies: $(VENV)/.ready-run
	@$(PY) -m benchmarks.studies.models.recovery --document docs/explanation/model-studies.md
	@$(PY) -m benchmarks.studies.models.recovery --own --document docs/explanation/model-studies.md
	@$(PY) -m benchmarks.studies.models.sbc --document docs/explanation/model-studies.md
	@$(PY) -m benchmarks.studies.models.user_sbc --document docs/explanation/model-studies.md
	@$(PY) -m benchmarks.studies.models.svi_rule --document docs/explanation/model-studies.md
	@$(PY) -m benchmarks.studies.models.sessions --document docs/explanation/model-studies.md
	@$(PY) -m benchmarks.studies.models.session_states --document docs/explanation/model-studies.md
	@$(PY) -m benchmarks.studies.models.new_sessions --document docs/explanation/model-studies.md

audit-studies: $(VENV)/.ready-run
	@$(PY) -m benchmarks.studies.audit.levels --document docs/explanation/audit-studies.md
	@$(PY) -m benchmarks.studies.audit.drift --document docs/explanation/audit-studies.md
	@$(PY) -m benchmarks.studies.audit.causes --document docs/explanation/audit-studies.md
	@$(PY) -m benchmarks.studies.audit.guarantees --document docs/explanation/audit-studies.md
	@$(PY) -m benchmarks.studies.audit.bounds --document docs/explanation/audit-studies.md
	@$(PY) -m benchmarks.studies.audit.target --document docs/explanation/audit-studies.md
	@$(PY) -m benchmarks.studies.audit.first_look --document docs/how-to/recording.md
	@$(PY) -m benchmarks.studies.audit.sets --document docs/how-to/audit.md $(if $(RECORDED),--recorded "$(RECORDED)")

interval-studies: $(VENV)/.ready-run
	@$(PY) -m benchmarks.studies.intervals.calibration --document docs/explanation/intervals.md
	@$(PY) -m benchmarks.studies.intervals.exponent --document docs/explanation/intervals.md
	@$(PY) -m benchmarks.studies.intervals.coverage --document docs/explanation/intervals.md
	@$(PY) -m benchmarks.studies.intervals.coverage --preview --data-sets 200 --sizes "6 x 3" --taps 20 --document docs/explanation/intervals.md
	@$(PY) -m benchmarks.studies.intervals.sessions --document docs/explanation/intervals.md
	@$(PY) -m benchmarks.studies.intervals.stored_taps --document docs/explanation/intervals.md
	@$(PY) -m benchmarks.studies.intervals.left_out --document docs/explanation/intervals.md
	@$(PY) -m benchmarks.studies.intervals.places --document docs/explanation/intervals.md
	@$(PY) -m benchmarks.studies.intervals.commands --document docs/explanation/intervals-commands.md
	@$(PY) -m benchmarks.studies.intervals.shared_training --document docs/explanation/intervals-commands.md

results: $(VENV)/.ready-run
	@$(PY) -m benchmarks.studies.results.reproduce --document docs/reference/results.md $(if $(RECORDED),--recorded "$(RECORDED)")
	@$(PY) -m benchmarks.studies.results.compare --document docs/explanation/comparison.md $(if $(RECORDED),--recorded "$(RECORDED)")
	@$(PY) -m benchmarks.studies.results.own_models --document docs/explanation/own-models.md $(if $(RECORDED),--recorded "$(RECORDED)")
	@$(PY) -m benchmarks.studies.results.holes --document docs/reference/results.md $(if $(RECORDED),--recorded "$(RECORDED)")

reference-studies: $(VENV)/.ready-run
	@$(PY) -m benchmarks.studies.beliefs.chain --document docs/explanation/calibration.md
	@$(PY) -m benchmarks.studies.results.open_choices --document docs/explanation/open-choices.md $(if $(RECORDED),--recorded "$(RECORDED)")
	@$(PY) -m benchmarks.studies.beliefs.unknown --document docs/explanation/unknown-objects.md

posteriors: $(VENV)/.ready-run
	@$(PY) -m benchmarks.posteriors.make --document docs/reference/posteriors/README.md
	@$(PY) -m benchmarks.posteriors.level --document docs/reference/posteriors/README.md

strategy-studies: $(VENV)/.ready-run
	@$(PY) -m benchmarks.studies.strategies.comparison --document docs/explanation/strategies.md $(if $(RECORDED),--recorded "$(RECORDED)")
	@$(PY) -m benchmarks.studies.strategies.tuning --document docs/how-to/tuning.md

fuzz: $(VENV)/.ready-run
	@$(PY) -m benchmarks.checks.fuzz
	@$(PY) -m benchmarks.checks.fuzz_files $(if $(FILES),--files $(FILES))
	@$(PY) -m benchmarks.checks.fuzz_commands $(if $(LINES),--lines $(LINES))

faults: $(VENV)/.ready-run
	@$(PY) -m benchmarks.checks.faults

firmware: $(VENV)/.ready-dev
	@SOLIDTOUCH_GRBL="$(or $(GRBL),$(SOLIDTOUCH_GRBL),$(error firmware needs a checkout of GRBL's sources: make firmware GRBL=DIR))" $(PY) -m pytest -rs --durations=5 tests/hardware/firmware

kills: $(VENV)/.ready-run
	@$(PY) -m benchmarks.checks.kills
	@$(PY) -m benchmarks.checks.collecting
	@$(PY) -m benchmarks.checks.interruptions

mutants: $(VENV)/.ready-dev
	@$(PY) -m benchmarks.checks.mutants --document docs/explanation/mutants.md $(if $(NUMBER),--number $(NUMBER))

house: $(VENV)/.ready-run
	@$(PY) -m benchmarks.checks.house $(VERSION)

peers: $(VENV)/.ready-dev
	@SCIPY_ARRAY_API=1 $(PY) -m benchmarks.peers.estimator --document docs/how-to/scikit-learn.md
	@$(PY) -m benchmarks.peers.compare --document docs/explanation/peers.md

wheel-validate: $(VENV)/.ready-dev
	@$(PY) -m benchmarks.peers.fresh $(if $(PYTHONS),--python $(PYTHONS)) --document docs/explanation/peers.md

docs: $(VENV)/.ready-docs
	@$(PY) -m benchmarks.site.build

docs-check: $(VENV)/.ready-docs
	@$(PY) -m benchmarks.site.build --without-notebooks --out build/site-check

man: $(VENV)/.ready-run
	@$(PY) -m benchmarks.site.manual

rig-demo: $(VENV)/.ready-run
	@PATH="$(CURDIR)/$(VENV)/bin:$$PATH" docs/examples/rig-demo.sh

# In an environment of its own, as cffconvert requires older packages than the tests do.
citation: $(VENV)/.ready-dev
	@$(PY) -m uv tool run cffconvert --validate

# Pins every dependency for Python 3.12 to 3.14, on every platform, without addresses.
lock: $(VENV)/.ready-dev
	@$(PY) -m uv pip compile pyproject.toml --all-extras --group dev --group dist --universal --python-version 3.12 --upgrade --quiet \
		--no-header --no-annotate --output-file constraints.txt

clean:
	rm -rf $(VENV) build dist *.egg-info

help:
	@echo "make run     reproduce the paper, half a minute"
	@echo "make setup   set up .venv for the tests, without running any"
	@echo "make test    run the tests except the slow ones; the first run compiles what later ones find in build/xla; TESTS= names files and folders"
	@echo "make test-times  the same, and list the 20 slowest"
	@echo "make test-all  run all tests, including whole commands, clusters and emulated rigs"
	@echo "make test-lowest  run the default tests with the oldest dependencies that pyproject.toml allows, on Python 3.12 (PYTHON=)"
	@echo "make test-newest  the same with the newest"
	@echo "make dist    build the source distribution and the wheel in dist; dist-check checks what they hold"
	@echo "make sdist-test  run the default tests in the unpacked source distribution"
	@echo "make wheel-test  install the wheel alone, without extras, and run commands; two minutes"
	@echo "make container  build the container image, by packaging/Dockerfile, with docker (CONTAINERS=podman)"
	@echo "make container-test  build it and that of the conformance kit, and run checks in them"
	@echo "make check   check lint, format, types and import layers"
	@echo "make format  fix lint and format"
	@echo "make bench   time kernels and commands, into docs/reference/performance.md; BEFORE=DIR adds an older checkout; bench-quick is a trial"
	@echo "make bench-cluster  overhead of a Dask cluster on this machine, into docs/how-to/cluster.md"
	@echo "make studies model recovery, calibration and end of fits, gain of session models, into docs/explanation/model-studies.md"
	@echo "make audit-studies  level and power of the audit, into docs/explanation/audit-studies.md"
	@echo "make interval-studies  coverage of intervals and level of the verdict on beliefs, into docs/explanation/intervals.md; hours"
	@echo "make results  results on simulated taps, with RECORDED=FOLDER also on recorded ones, into docs/"
	@echo "make reference-studies  calibration of beliefs, open choices of the paper, level and power of unknown"
	@echo "make posteriors  reference posteriors of the models and the level of the verdict on draws, half an hour"
	@echo "make strategy-studies  strategies of moving and stopping, regret against the exact rule, tuning"
	@echo "make docs    build the documentation site in build/site; the first run takes minutes, as notebooks run"
	@echo "make docs-check  build it in build/site-check without running notebooks, to check pages and links; half a minute"
	@echo "make man     write man pages of all commands into build/man"
	@echo "make rig-demo  collect, fit and perceive on emulated devices"
	@echo "make faults  tap an emulated rig under random faults, damage every byte of its commands, and report; 11 minutes"
	@echo "make firmware GRBL=DIR  run the stage driver on GRBL's own firmware, built from your checkout of its sources; 5 minutes"
	@echo "make kills   kill data collections and all long commands at random moments, fill their disks, start them twice; two hours"
	@echo "make mutants  plant small errors and count those that tests notice, into docs/explanation/mutants.md; hours, resumes"
	@echo "make house   print sizes and shape of the code; VERSION=REVISION measures another version, as far as nothing has to run"
	@echo "make peers   run examples of other packages and checks of scikit-learn, into docs/explanation/peers.md and docs/how-to/scikit-learn.md"
	@echo "make wheel-validate  run validate in fresh installations of the wheel for PYTHONS=, into docs/explanation/peers.md"
	@echo "make fuzz    feed the decoders a million random and mutated inputs, the readers 1000 damaged files of each format (FILES=), the commands 10 damaged lines of each of 29 (LINES=)"
	@echo "make citation  check CITATION.cff by cffconvert, which is downloaded"
	@echo "make lock    pin the newest dependencies in constraints.txt"
	@echo "make clean   remove generated files"

$(VENV)/.ready-run: pyproject.toml constraints.txt
	@./.ci/make-venv $(VENV)
	@echo "Installing solidtouch into $(VENV) ..."
	@./.ci/install $(VENV) -e '.[rig,cluster]'
	@touch $@

$(VENV)/.ready-dev: $(VENV)/.ready-run
	@echo "Installing what the tests need into $(VENV) ..."
	@./.ci/install $(VENV) --group dev
	@touch $@

$(VENV)/.ready-dist: $(VENV)/.ready-dev
	@echo "Installing what checks of the package need into $(VENV) ..."
	@./.ci/install $(VENV) --group dist
	@touch $@

$(VENV)/.ready-docs: $(VENV)/.ready-run
	@echo "Installing what the site needs into $(VENV) ..."
	@./.ci/install $(VENV) -e '.[rig,cluster,docs]'
	@touch $@
