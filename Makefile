# Two commands to know: `make demo` and `make test`. Both make and fill $(VENV) by themselves, once.
PYTHON ?= python3
# Of ROS 2: jazzy or kilted, each in an environment of its own.
ROS = jazzy
VENV = .venv$(if $(filter-out jazzy,$(ROS)),-$(ROS))
OUT = demo-out
PHOTONS =
MOTION =
ARGS =

.PHONY: help venv demo test lint clean

help:
	@echo 'make demo [PHOTONS=file] [OUT=demo-out]  photons to point clouds over ROS 2: a recording, a picture, a table'
	@echo '          MOTION=walk|drone|spin           the same, of a sensor that moves, deskewed by its odometry'
	@echo 'make test [ARGS=...]                     the tests; ARGS goes to pytest'
	@echo 'make lint                                ruff'
	@echo 'make venv                                only make or refresh the virtual environment'
	@echo 'make clean                               remove it and everything that was built'
	@echo 'Variables: PYTHON=$(PYTHON) (3.11 or newer), ROS=$(ROS) (or kilted), VENV=$(VENV)'

venv:
	@'$(PYTHON)' scripts/make_venv.py '$(VENV)' '$(ROS)'

demo: venv
	@'$(VENV)/bin/srt3d' demo $(if $(PHOTONS),--photons '$(PHOTONS)') $(if $(MOTION),--motion '$(MOTION)') --out '$(OUT)'

test: venv
	@'$(VENV)/bin/python' -m pytest -n auto --dist loadfile --no-loadscope-reorder $(ARGS)

lint: venv
	@'$(VENV)/bin/ruff' check .

clean:
	rm -rf '$(VENV)' build install log dist demo-out *.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -not -path './.git/*' -prune -exec rm -rf {} +
