# Two commands to know: `make demo` and `make test`. Each installs what it needs into $(VENV), once.
PYTHON ?= python3
# The distribution of ROS 2, each in an environment of its own.
ROS = jazzy
ifneq ($(filter-out jazzy kilted,$(ROS)),)
$(error ROS=$(ROS): expected jazzy or kilted)
endif
other_ros = $(filter-out jazzy,$(ROS))
VENV = .venv$(addprefix -,$(other_ros))
MACHINE := $(shell uname -m)
CONSTRAINTS = -c constraints.txt
OUT = demo-out
MOTION =
ARGS =
# Containers set it, and each of the hundreds of processes of a test run would compile its modules anew.
unexport PYTHONDONTWRITEBYTECODE

# --no-compile: Python compiles what is imported; all of it would take 20 s and 0.1 GB.
pip = $(VENV)/bin/python -m pip --disable-pip-version-check install --quiet --no-compile $(CONSTRAINTS)
# pytest-xdist would replace a worker that died, and then wait for ever for tests that it has given to nobody.
pytest = $(VENV)/bin/python -m pytest -n auto --dist loadfile --no-loadscope-reorder --max-worker-restart 0
# What takes longest: programs as users start them, the documents' commands, installations, two machines, compilers.
long = tests/test_demo.py tests/processes/test_supervisor.py tests/docs tests/test_install.py \
	tests/nodes/test_two_machines.py tests/core/test_same_bits.py tests/kernels/test_device.py \
	tests/kernels/test_compiling.py
gpu = $(if $(wildcard /proc/driver/nvidia/version),gpu)
comma = ,
installed_from = setup.py pyproject.toml package.xml constraints.txt $(wildcard scripts/nodes/* msg_schemas/* launch/* config/*)

.PHONY: help demo test test-all test-newest test-processors wheels-of-ros docs lint clean

help:
	@echo 'make demo [OUT=demo-out]                 photons to point clouds over ROS 2: a recording, a picture, a table'
	@echo '          MOTION=walk                      the same, of a sensor that moves, deskewed by its odometry'
	@echo 'make test [ARGS=...]                     the tests; ARGS goes to pytest'
	@echo 'make test-all                            these, and demo, `srt3d up`, installations, documents, compilers'
	@echo 'make test ROS=kilted                     the tests with ROS 2 Kilted instead of Jazzy, in .venv-kilted'
	@echo 'make test-newest                         the tests with the newest releases that pyproject.toml allows'
	@echo 'make test-processors                     the tests of the computation, as on processors without AVX, and with AVX2'
	@echo 'make docs                                the documentation as a web site, build/docs/index.html'
	@echo 'make lint                                ruff, and pyright where types are kept'
	@echo 'make clean                               remove .venv, .venv-… and everything that was built'
	@echo 'Variables: PYTHON=$(PYTHON) (3.11 or newer), ROS=$(ROS), VENV=$(VENV)'

demo: $(VENV)/demo-ready
	@$(VENV)/bin/srt3d demo $(if $(MOTION),--motion '$(MOTION)') --out '$(OUT)'

test: $(VENV)/test-ready
	@$(pytest) $(addprefix --ignore=,$(long)) $(ARGS)

test-all: $(VENV)/test-ready
	@$(pytest) $(ARGS)

test-newest:
	@$(MAKE) --no-print-directory test VENV=$(VENV)-newest CONSTRAINTS=

test-processors: test-on-x86-64 test-on-x86-64-v3

# An empty NUMBA_CPU_FEATURES belongs to the name: without it, numba adds those of this processor. torch keeps its
# compiled code without the capability in its key.
test-on-%: $(VENV)/test-ready
	@echo '[$*] compiling the kernels and testing'
	@NUMBA_CPU_NAME=$* NUMBA_CPU_FEATURES= NUMBA_CACHE_DIR='$(CURDIR)/build/$*/numba' ATEN_CPU_CAPABILITY=default \
		TORCHINDUCTOR_CACHE_DIR='$(CURDIR)/build/$*/torch' $(pytest) tests/core tests/kernels tests/datasets $(ARGS)

docs: $(VENV)/docs-ready
	@$(VENV)/bin/python -m sphinx -W --quiet docs build/docs && echo build/docs/index.html

lint: $(VENV)/test-ready
	@$(VENV)/bin/ruff check .
	@$(VENV)/bin/pyright --pythonpath $(VENV)/bin/python

# PyPI has them for x86_64 only.
wheels-of-ros:
	@test $(MACHINE) = x86_64 || { echo 'PyPI has no ROS 2 for $(MACHINE): install it with apt, or srt3d_ros without ROS; both are in README.md, Install' >&2; exit 1; }

# What every environment starts with.
$(VENV)/made:
	@'$(PYTHON)' -c 'import sys; v = sys.version_info; sys.exit(f"srt3d_ros needs Python 3.11 or newer and this is {v[0]}.{v[1]}: try make PYTHON=python3.12" if v < (3, 11) else 0)'
	@'$(PYTHON)' -m venv $(VENV)
	@$(pip) 'setuptools>=77.0.3,<80'
	@touch $@

$(VENV)/demo-ready: $(installed_from) | wheels-of-ros $(VENV)/made
	@echo '[1/3] installing ROS 2 $(ROS), numba, rerun and the rest into $(VENV): 1.4 GB, one or two minutes'
	@$(pip) --no-build-isolation --editable '.[ros$(addprefix -,$(other_ros)),record,review$(addprefix $(comma),$(gpu))]'
	@echo '[2/3] placing the executables of the nodes'
	@$(VENV)/bin/python -W ignore setup.py --quiet install_data --install-dir $(VENV)
	@echo '[3/3] compiling the kernels for this processor: a minute'
	@$(VENV)/bin/srt3d compile
	@touch $@

# Neither ROS 2 nor compiled kernels: the site shows stored results.
$(VENV)/docs-ready: $(installed_from) | $(VENV)/made
	@echo '[docs] installing Sphinx and the library into $(VENV): 0.6 GB, a minute'
	@$(pip) --no-build-isolation --editable '.[docs]'
	@touch $@

# PyPI's torch brings 3 GB of CUDA: without a GPU, its own index of CPU builds is tried first.
$(VENV)/test-ready: $(VENV)/demo-ready
	@echo '[test] installing torch and the test tools'
	@$(if $(gpu),true,$(pip) --retries 0 --timeout 10 --index-url https://download.pytorch.org/whl/cpu torch 2>/dev/null || true)
	@$(pip) --no-build-isolation --editable '.[test]'
	@touch $@

clean:
	rm -rf .venv .venv-* build install log dist demo-out *.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -not -path './.git/*' -prune -exec rm -rf {} +
