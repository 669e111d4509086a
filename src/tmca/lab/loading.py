"""Exported decoders as functions: no code of a file is run."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from tmca.errors import DataError, SettingError, TmcaError
from tmca.lab.checked_graph import load_program
from tmca.stored_numbers import check_finite


def load_exported(file: str | Path, trust: bool = False) -> Callable[[Tensor], Tensor]:
    """An exported decoder as a function of the snapshot (1, 1, H, W').

    Args:
        file: of `export_decoder`.
        trust: load it as `torch.export.load` does, which runs whatever code the file holds.

    Raises:
        DataError: no such file, a broken one, or one that holds more than tensors and the operators of a decoder.
        SettingError: onnx or onnxruntime is missing.
    """
    file = Path(file)
    if not file.is_file():
        raise DataError(file, "no such file", "an exported decoder", "write it with `tmca decoder export`")
    if file.suffix == ".pt2":
        if not trust:
            return load_program(file)
        with _loading(file), quiet("torch.export"):
            program: Callable[[Tensor], Tensor] = torch.export.load(str(file)).module()
        return program
    return _loaded_by_onnx(file)


@contextmanager
def _loading(file: Path) -> Iterator[None]:
    """Within it, whatever a loader raises is a DataError."""
    try:
        yield
    except TmcaError:
        raise
    except Exception as error:  # each loader has errors of its own for a broken file
        found = f"a file that cannot be read ({type(error).__name__})"
        raise DataError(file, found, "an exported decoder", "write it again with `tmca decoder export`") from error


def _loaded_by_onnx(file: Path) -> Callable[[Tensor], Tensor]:
    """A model of ONNX's own operators, all of it in the one file."""
    onnx, runtime = package("onnx"), package("onnxruntime")
    with _loading(file):
        content = file.read_bytes()
        model = onnx.load_model_from_string(content)
        tensors = onnx.external_data_helper._get_all_tensors(model)
        if any(onnx.external_data_helper.uses_external_data(tensor) for tensor in tensors):
            raise DataError(file, "tensors that lie in other files", "all in this one", "export it again")
        domains = {one.domain for one in model.opset_import} - {"", "ai.onnx"}
        if domains or model.functions:
            found = f"operators of {', '.join(sorted(domains)) or 'its own'}"
            raise DataError(file, found[:80], "those of ONNX", "export it again with `tmca decoder export`")
        session = runtime.InferenceSession(content, providers=["CPUExecutionProvider"])

    def run(snapshot: Tensor) -> Tensor:
        values = session.run(None, {"snapshot": snapshot.numpy()})[0]
        check_finite(values, file, "an estimate", "export it again with `tmca decoder export`")
        return torch.from_numpy(values)

    return run


@contextmanager
def quiet(name: str) -> Iterator[None]:
    """No warnings of a logger and those below it; what fails raises all the same."""
    logger = logging.getLogger(name)
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


def package(name: str) -> Any:
    import importlib

    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise SettingError("onnx", f"no package {name}", "it", "pip install 'tmca[onnx]'") from error
