# flashtemp: `make demo` runs the main job, `make test` the tests.  Each sets up what it needs in .venv when
# that is missing or older than pyproject.toml: a run, then the tests, then the documentation.  Nothing outside
# this folder is touched, except that root (or sudo without a password) installs SUNDIALS where apt-get has it.

CASE ?= cases/run_in
PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
PIP := .venv/bin/python -m pip --disable-pip-version-check
RUN := .venv/.run
READY := .venv/.ready
DOCS := .venv/.docs
INSTALL := PYTHONWARNINGS="ignore:Editable installation" $(PIP) install --quiet --no-compile --editable
# once, on all cores; a quarter of all modules are tests of libraries, which nobody imports
COMPILE := .venv/bin/python -m compileall -q -j 0 -x '/tests?/' .venv/lib flashtemp viz >/dev/null 2>&1 || true

.PHONY: help demo test test-all attack bench-smoke coverage lint docs odes browser clean

help:  ## this list
	@sed -n 's/^\([a-z-]*\):.*## /  make \1	/p' Makefile

demo: $(RUN)  ## simulate cases/run_in; CASE=... for another
	.venv/bin/flashtemp run $(CASE)

test: $(READY)  ## run the tests but the long ones, a file per core at a time; ARGS=... goes to pytest
	OMP_NUM_THREADS=1 .venv/bin/python -m pytest -n auto --dist loadfile --no-loadscope-reorder $(ARGS)

test-all: $(READY)  ## run the long tests too
	OMP_NUM_THREADS=1 .venv/bin/python -m pytest -n auto --dist loadfile --no-loadscope-reorder -m "" $(ARGS)

attack: $(READY)  ## kills, full disks, damage at random: an hour; ARGS="--share 0.1 kill" for less
	OMP_NUM_THREADS=1 .venv/bin/python tests/attack/attack.py $(ARGS)

bench-smoke: $(READY)  ## every benchmark, small: do we and the peers stay within the stated errors?
	OMP_NUM_THREADS=1 .venv/bin/python benchmarks/smoke.py

coverage: $(READY)  ## run the tests and tell which lines they miss; solver and discovery need 85 % a module
	OMP_NUM_THREADS=1 .venv/bin/python -m pytest -n auto --dist loadfile --no-loadscope-reorder --cov --cov-report= $(ARGS)
	.venv/bin/coverage report --skip-covered
	@.venv/bin/coverage report --include='*/solver/*,*/discovery/*' | \
		awk '$$1 ~ /\.py$$/ && $$NF + 0 < 85 {print "below 85 %:", $$0; low = 1} END {exit low}'

lint: $(READY)  ## ruff: rules and format; mypy: types
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy flashtemp

docs: $(DOCS)  ## the documentation as a site in build/site: notebooks executed, links within it checked
	OMP_NUM_THREADS=1 .venv/bin/sphinx-build --quiet --fail-on-warning --keep-going -j auto -b html docs build/site

# The page is tested in the distribution's own Chromium; where there is none its tests in the browser are skipped.
browser: | .venv/bin/pip
	@root=env; [ $$(id -u) = 0 ] || root="sudo -n env"; \
	if ! command -v chromium-headless-shell chromium >/dev/null && command -v apt-get >/dev/null && $$root true 2>/dev/null; then \
		$$root $(APT) install -y --no-install-recommends chromium-headless-shell || true; \
	fi

clean:  ## remove .venv and everything built or cached, but no results
	rm -rf .venv build dist *.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis .coverage .coverage.*
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

.venv/bin/pip:
	@test -n "$(PYTHON)" || { echo "flashtemp needs Python 3.11 or later: apt-get install python3-venv"; exit 1; }
	@echo "setting up .venv for runs: about two minutes on two cores, 330 MB to download, 1.4 GB on disk"
	@$(PYTHON) -m venv --clear .venv

$(RUN): pyproject.toml | .venv/bin/pip
	@$(PIP) install --quiet --upgrade pip
	@$(INSTALL) .
	@$(COMPILE)
	@$(MAKE) --no-print-directory odes
	@touch $@

$(READY): $(RUN)
	@echo "adding what the tests need: half a minute, 170 MB to download, 0.6 GB on disk"
	@$(INSTALL) '.[test,dev]'
	@$(COMPILE)
	@$(MAKE) --no-print-directory browser
	@touch $@

$(DOCS): $(RUN)
	@echo "adding what the documentation needs: half a minute, 40 MB to download, 0.2 GB on disk"
	@$(INSTALL) '.[docs]'
	@$(COMPILE)
	@touch $@

# scikits-odes is compiled on the system's SUNDIALS: 3.0 on SUNDIALS 6 (Python <= 3.12), 3.1 on 7.
# Where that cannot be, scikit-sundae, a wheel with SUNDIALS inside, does the same work.
SUNDIALS = printf '\#include <Python.h>\n\#include <sundials/sundials_config.h>\n' | $${CC:-cc} -E -dM - 2>/dev/null \
	-I"$$(.venv/bin/python -c 'import sysconfig; print(sysconfig.get_path("include"))')" | \
	sed -n 's/^.define SUNDIALS_VERSION_MAJOR //p'
# Debian compiles SUNDIALS without optimisation, and vectors take 2 to 4 times as long: the same version again, from the
# distribution's own source, goes before it (a runtime path of scikits-odes; without the folder the system's is used).
# Sums over vectors may be taken in any order (NaN stays NaN), in that one folder: one after the other they take twice as long.
FAST := .venv/sundials
SUMS := -fassociative-math -fno-signed-zeros -fno-trapping-math -fno-math-errno -funroll-loops -fvariable-expansion-in-unroller
APT = DEBIAN_FRONTEND=noninteractive apt-get -q -o DPkg::Lock::Timeout=60 </dev/null >>.venv/apt.log 2>&1

odes: | .venv/bin/pip  ## try scikits-odes again, after a change of the system's SUNDIALS
	@major=$$($(SUNDIALS)); root=env; [ $$(id -u) = 0 ] || root="sudo -n env"; \
	if [ -z "$$major" ] && command -v apt-get >/dev/null && $$root true 2>/dev/null; then \
		echo "installing SUNDIALS with apt-get"; \
		$$root $(APT) update; $$root $(APT) install -y --no-install-recommends libsundials-dev python3-dev; \
		major=$$($(SUNDIALS)); \
	fi; \
	case "$$major" in 6) odes=3.0;; 7) odes=3.1;; *) odes=;; esac; \
	echo "numpy<2.5" >.venv/build-constraint.txt; \
	if [ -z "$$odes" ]; then \
		echo "CVODE: scikit-sundae (scikits-odes needs a C compiler and the headers of Python and SUNDIALS 6 or 7)"; \
	elif { $(MAKE) --no-print-directory $(FAST)/lib || true; } && LDFLAGS="-Wl,-rpath,'$$PWD/$(FAST)/lib'" \
			$(PIP) install --no-cache-dir --build-constraint .venv/build-constraint.txt "scikits-odes-sundials==$$odes.*" \
			>.venv/odes.log 2>&1 && .venv/bin/python -c "import scikits_odes_sundials.cvode" 2>>.venv/odes.log; then \
		echo "CVODE: scikits-odes $$odes on SUNDIALS $$major"; \
	else \
		$(PIP) uninstall --quiet --yes scikits-odes-sundials 2>/dev/null; \
		echo "CVODE: scikit-sundae (scikits-odes $$odes did not build on SUNDIALS $$major, see .venv/odes.log)"; \
	fi

$(FAST)/lib:
	@version=$$(dpkg-query -W -f '$${source:Package}=$${source:Version}' libsundials-dev 2>/dev/null); \
	mkdir -p $(FAST)/src/lists/partial && fast="$$PWD/$(FAST)" && cd $(FAST)/src || exit 1; list=apt.sources; \
	for file in /etc/apt/sources.list.d/*.sources; do sed 's/^Types:.*/Types: deb-src/' "$$file"; echo; done >$$list 2>/dev/null; \
	if ! grep -q deb-src $$list; then \
		list=apt.list; sed -n 's/^deb /deb-src /p' /etc/apt/sources.list /etc/apt/sources.list.d/*.list >$$list 2>/dev/null; \
	fi; \
	get() { timeout 60 apt-get -q -o Dir::Etc::sourcelist="$$PWD/$$list" -o Dir::Etc::sourceparts=/dev/null \
		-o Dir::State::lists="$$PWD/lists" -o Debug::NoLocking=true "$$@"; }; \
	if [ -n "$$version" ] && command -v cmake >/dev/null && \
			{ get update && get --download-only source "$$version" && tar xf *.orig.tar.* --strip-components=1 && \
			sed -i '1i add_compile_options($(SUMS))' src/nvector/serial/CMakeLists.txt && \
			timeout 60 cmake -S . -B build -DCMAKE_BUILD_TYPE=Release -DCMAKE_C_FLAGS_RELEASE=-O3 -DCMAKE_C_FLAGS=-fcommon \
				-DCMAKE_INSTALL_PREFIX="$$fast/new" -DCMAKE_INSTALL_LIBDIR=lib -DCMAKE_INSTALL_RPATH='$$ORIGIN' \
				-DBUILD_STATIC_LIBS=OFF -DEXAMPLES_ENABLE_C=OFF -DEXAMPLES_INSTALL=OFF \
				$(foreach part,ARKODE CVODES IDA IDAS KINSOL,-DBUILD_$(part)=OFF) && \
			timeout 120 cmake --build build --parallel --target install && mv ../new/lib ../lib; } >../log 2>&1; then \
		echo "SUNDIALS: compiled with optimisation, from $$version"; \
	else \
		echo "SUNDIALS: as the distribution compiled it, without optimisation; runs take twice as long (docs/explanation/performance.md)"; \
	fi; \
	rm -rf ../src ../new
