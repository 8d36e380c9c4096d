# Everything sets itself up in .venv; nothing but Python (3.11 to 3.13) and make is needed.
#   make figures   the experiment, every notebook, figures/        make test   all checks
#   make studies   every study (data/studies/), then figures       make check-figures   what would change, and by how much
#   make lab       JupyterLab, first notebook                     make clean  remove .venv and cached runs

PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.ready

.PHONY: figures studies check-figures test lab clean

figures: $(READY)
	$(BIN)/python -m workbench figures

studies: $(READY)
	$(BIN)/python -m workbench study all
	$(BIN)/python -m workbench figures

check-figures: $(READY)
	$(BIN)/python -m workbench figures --check

test: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy workbench
	$(BIN)/python -W error -m pytest -n 2 --dist worksteal

lab: $(READY)
	$(BIN)/jupyter lab --notebook-dir=. notebooks/00_start_here.ipynb

$(READY): environment.txt pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r environment.txt
	touch $(READY)

clean:
	rm -rf .venv runs
