# Every target sets up what it needs: a virtual environment in .venv, made once.
PYTHON ?= python3
DATA ?= ../shared/data
export OMP_NUM_THREADS ?= 1
# One more than two cores: some tests wait.
WORKERS ?= 3

.PHONY: demo test test-all lint fuzz kills benchmarks train-shipped docs dist clean

.venv/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	.venv/bin/pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[dev]"
	touch $@

demo: .venv/installed
	.venv/bin/tmca demo --overwrite

test: .venv/installed
	.venv/bin/pytest -n $(WORKERS) -m "not slow" --durations=20

test-all: .venv/installed
	.venv/bin/pytest -n $(WORKERS) --durations=20

lint: .venv/installed
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy

# Every command killed and stopped at twenty moments each.
kills: .venv/installed
	TMCA_KILL_MOMENTS=20 .venv/bin/pytest tests/cli/test_kill_table.py

# A campaign of 20 000 damaged files; killed, it goes on where it stopped.
fuzz: .venv/installed
	.venv/bin/python -m tests.fuzz

benchmarks: .venv/installed
	.venv/bin/python benchmarks/spectral.py
	.venv/bin/python benchmarks/light_field.py
	.venv/bin/python benchmarks/spectral_depth.py
	.venv/bin/python benchmarks/realtime.py
	.venv/bin/python benchmarks/training.py
	.venv/bin/python benchmarks/viewer.py

# The documentation site in site/, without network; fails at a broken link.
docs: .venv/installed
	NO_MKDOCS_2_WARNING=1 .venv/bin/mkdocs build --strict

# What the Python Package Index would take, in dist/, checked.
dist:
	$(PYTHON) -m venv .dist
	.dist/bin/pip install --quiet --disable-pip-version-check build twine
	rm -rf dist
	.dist/bin/python -m build --quiet
	.dist/bin/twine check --strict dist/*

# Ten minutes of training of a network for any spectral camera, large on a graphics processor and small elsewhere; run
# again, it goes on where it ended. Writes runs/shipped/universal.safetensors. Other data: `make train-shipped
# DATA=folder`, a folder with splits/.
train-shipped: .venv/installed runs/shipped/cubes/about.pt
	.venv/bin/python -m studies.shipped.train fit runs/shipped/cubes --out runs/shipped --seconds 600
	.venv/bin/python -m studies.shipped.train ship runs/shipped/cubes --load runs/shipped/state.pt --out runs/shipped \
		--trained "make train-shipped"

# The file that is written last.
runs/shipped/cubes/about.pt: | .venv/installed
	.venv/bin/python -m studies.shipped.train pack $(DATA)/splits --out runs/shipped/cubes

clean:
	rm -rf .venv .dist dist
