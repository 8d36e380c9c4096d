# Everything sets itself up in .venv; nothing but Python (3.11 to 3.13) and make is needed.
#   make lab       JupyterLab, first notebook                     make test   all checks
#   make figures   the experiment, every notebook, figures/       make check-figures   what would change, and by how much
#   make studies   every study (data/studies/), then figures      make setup        .venv, and nothing else
#   make clean     remove caches                                  make distclean   remove .venv too, and runs/ after a yes
# make lab PYTHON=python3.12 takes another Python; LAB_ARGS="--no-browser --port=9000" goes to JupyterLab.

PYTHON ?= python3
LAB_ARGS ?=
BIN := .venv/bin
VERSION := $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2> /dev/null)
READY := .venv/.ready-$(VERSION)
ROOT_ARGS := $(shell [ "$$(id -u)" = 0 ] && echo --allow-root)  # in a container

define CHECK
import sys
found = sys.version_info[:2]
if not (3, 11) <= found <= (3, 13):
    words = "needs Python 3.11 to 3.13, $(PYTHON) is %d.%d; for example: make lab PYTHON=python3.12"
    sys.exit(words % found)
print("%d.%d" % found)
endef
export CHECK
# the loops of plain configurations and of all others, side by side
define COMPILE
from functools import partial
import workbench as wb
wb.sweep(partial(wb.prepare, progress=False), [wb.ConvoyConfig(), wb.SETTINGS["infrared"]])
endef
export COMPILE

.PHONY: setup figures studies check-figures test lab clean distclean

figures: $(READY)
	$(BIN)/python -m workbench figures

studies: $(READY)
	$(BIN)/python -m workbench study all
	$(BIN)/python -m workbench figures

setup: $(READY)

check-figures: $(READY)
	$(BIN)/python -m workbench figures --check

test: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy workbench
	$(BIN)/python -W error -m pytest -n 2 --dist worksteal

lab: $(READY)
	$(BIN)/jupyter lab $(ROOT_ARGS) --notebook-dir=. $(LAB_ARGS) notebooks/00_start_here.ipynb

# a .venv of another Python is begun anew
$(READY): environment.txt pyproject.toml
	@command -v $(PYTHON) > /dev/null || { echo "no $(PYTHON) here; needs Python 3.11 to 3.13: make lab PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -c "$$CHECK" > /dev/null
	@want=$$($(PYTHON) -c "$$CHECK"); have=$$($(BIN)/python -c "$$CHECK" 2> /dev/null || true); \
	[ "$$want" = "$$have" ] && clear= || clear=--clear; $(PYTHON) -m venv $$clear .venv
	@echo "installing some 130 packages into .venv (about 1.6 GB, a minute or two) ..."
	$(BIN)/python -m pip install --disable-pip-version-check -r environment.txt
	@echo "compiling what most runs need (half a minute) ..."
	$(BIN)/python -c "$$COMPILE"
	@touch $@
	@echo "ready: make lab opens the first notebook"

clean:
	rm -rf .mypy_cache .pytest_cache .ruff_cache .hypothesis .benchmarks
	find workbench tests -name __pycache__ -type d -prune -exec rm -rf {} +

distclean: clean
	rm -rf .venv workbench.egg-info
	@if [ -d runs ]; then printf "remove runs/ with all that was learned, too? [y/N] "; read answer; \
	[ "$$answer" = y ] && rm -rf runs || echo "runs/ is kept"; fi
