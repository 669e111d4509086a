# Every target sets up what it needs: a virtual environment in .venv, made once.
PYTHON ?= python3
export OMP_NUM_THREADS ?= 1

.PHONY: demo test test-all lint fuzz kills benchmarks clean

.venv/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	.venv/bin/pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[dev]"
	touch $@

demo: .venv/installed
	.venv/bin/tmca demo --overwrite

test: .venv/installed
	.venv/bin/pytest -n 2 -m "not slow" --durations=20

test-all: .venv/installed
	.venv/bin/pytest -n 2 --durations=20

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

clean:
	rm -rf .venv
