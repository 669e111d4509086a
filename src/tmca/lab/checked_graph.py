"""Programs of `torch.export` without its loader, which unpickles and executes: tensors read as bytes, and a graph whose
operators are on a list, computed one after the other."""

from __future__ import annotations

import re
import sys
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from tmca.attributes import json_of
from tmca.errors import DataError, TmcaError
from tmca.lab.graph_file import Graph, GraphArgument, GraphConfig, GraphMeta, GraphNode, GraphProgram

LARGEST = 8 * 2**30
"""Bytes of the tensors that a graph may need at once."""
OPERATORS = frozenset(
    {
        "_assert_tensor_metadata", "abs", "add", "add_", "addcdiv", "addcmul", "addcmul_", "alias", "amax", "amin",
        "avg_pool2d", "batch_norm", "bmm", "cat", "chunk", "clamp", "clamp_max", "clamp_min", "clone",
        "contiguous", "conv2d", "conv_transpose2d", "cos", "detach", "detach_", "div", "div_", "dropout",
        "einsum", "exp", "expand", "flatten", "flip", "full", "full_like", "ge", "gelu", "group_norm", "gt",
        "index_add", "index_select", "interpolate", "layer_norm", "le", "leaky_relu", "lift_fresh_copy",
        "linalg_vecdot", "linear", "log", "lt", "matmul", "max", "max_pool2d", "maximum", "mean", "min",
        "minimum", "mm", "movedim", "mul", "mul_", "narrow", "ne", "neg", "new_zeros", "ones", "ones_like",
        "pad", "permute", "pixel_shuffle", "pixel_unshuffle", "pow", "reciprocal", "relu", "relu_", "repeat",
        "reshape", "rsqrt", "select", "sigmoid", "silu", "sin", "slice", "softmax", "softplus", "split",
        "split_with_sizes", "sqrt", "square", "squeeze", "stack", "std", "sub", "sub_", "sum", "tanh", "to",
        "transpose", "unbind", "unflatten", "unfold", "unsqueeze", "upsample_bilinear2d", "upsample_nearest2d",
        "var", "view", "where", "zeros", "zeros_like",
    }
)  # fmt: skip
"""Of ATen: they compute with tensors, and read no file and no memory but theirs."""
_TARGET = re.compile(r"torch\.ops\.aten\.([a-z][a-z0-9_]*|_assert_tensor_metadata)\.([A-Za-z][A-Za-z0-9_]*)")
_AUTOCAST = "torch.ops.higher_order.wrap_with_autocast"
_DTYPES = {
    1: torch.uint8, 2: torch.int8, 3: torch.int16, 4: torch.int32, 5: torch.int64, 6: torch.float16, 7: torch.float32,
    8: torch.float64, 10: torch.complex64, 11: torch.complex128, 12: torch.bool, 13: torch.bfloat16,
}  # fmt: skip
_FORMATS = {1: torch.contiguous_format, 2: torch.channels_last, 4: torch.preserve_format}
_REMEDY = "export it again with `tmca decoder export`; --trust runs what the file holds, for files of your own"


@dataclass(frozen=True)
class CheckedProgram:
    """A program of one tensor.

    Args:
        path: its file.
        graph: whose operators are on the list.
        tensors: by the names of the graph's inputs.
        entry: name of the input that is no stored tensor.
        shape: of that.
    """

    path: Path
    graph: Graph
    tensors: Mapping[str, Tensor]
    entry: str
    shape: tuple[int, ...]

    @torch.no_grad()
    def __call__(self, snapshot: Tensor) -> Tensor:
        """What the program makes of a tensor of its shape.

        Raises:
            DataError: one of another shape, or a graph that does not compute.
        """
        if tuple(snapshot.shape) != self.shape:
            raise DataError(self.path, f"a snapshot of shape {tuple(snapshot.shape)}", f"one of {self.shape}")
        with _computing(self.path):
            return _outputs(self.graph, {**self.tensors, self.entry: snapshot}, self.path)[0]

    def rehearse(self) -> None:
        """Compute shapes alone, which takes no memory.

        Raises:
            DataError: a graph that does not compute, or needs more than ``LARGEST``.
        """
        tensors = {name: tensor.to("meta") for name, tensor in self.tensors.items()}
        with torch.no_grad(), _computing(self.path):
            entry = torch.empty(self.shape, device="meta")
            _outputs(self.graph, {**tensors, self.entry: entry}, self.path)


def load_program(path: Path) -> CheckedProgram:
    """Read what `torch.export.save` wrote of one input and one output; pickles in the file are not looked at.

    Raises:
        DataError: another file, one with pickled tensors, or a graph with operators that are not on the list.
    """
    with _archive(path) as files:
        program = _json(files, "models/model.json", path, GraphProgram)
        stored = _stored(files, "weights", "weight_", path) | _stored(files, "constants", "tensor_", path)
    _check(program.graph, path)
    tensors: dict[str, Tensor] = {}
    entries: list[str] = []
    for spec in program.inputs:
        if spec.tensor is None:
            entries += spec.given.names if spec.given else []
        elif spec.tensor.stored in stored:
            tensors[spec.tensor.name] = stored[spec.tensor.stored]
        else:
            raise DataError(path, f"no tensor {spec.tensor.stored}", "all of the graph's", _REMEDY)
    if len(entries) != 1 or entries[0] not in program.graph.tensor_values:
        raise DataError(path, f"a graph of {len(entries)} inputs", "one: the snapshot", _REMEDY)
    shape = tuple(length.as_int for length in program.graph.tensor_values[entries[0]].sizes)
    checked = CheckedProgram(path, program.graph, tensors, entries[0], shape)
    checked.rehearse()
    return checked


@contextmanager
def _archive(path: Path) -> Iterator[dict[str, Any]]:
    """Name of a member below the archive's folder → what reads it; members are as large as they say."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if sum(member.file_size for member in members) > path.stat().st_size:
                raise DataError(path, "members larger than the file", "tensors as they are", _REMEDY)
            names = [member.filename.partition("/")[2] for member in members]
            if len(set(names)) < len(names):
                raise DataError(path, "two members of one name", "each once", _REMEDY)
            yield {name: (archive, member) for name, member in zip(names, members, strict=True)}
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError, RuntimeError, EOFError) as error:
        if isinstance(error, TmcaError):
            raise
        found = f"a file that cannot be read ({error})"
        raise DataError(path, found, "an exported decoder", "write it again with `tmca decoder export`") from None


def _bytes(files: Mapping[str, Any], name: str, path: Path) -> bytes:
    if name not in files:
        raise DataError(path, f"no {name} in it", "an exported decoder", _REMEDY)
    archive, member = files[name]
    return bytes(archive.read(member))


def _json(files: Mapping[str, Any], name: str, path: Path, kind: type[Any]) -> Any:
    return json_of(_bytes(files, name, path), f"{path}: {name}", kind)


def _stored(files: Mapping[str, Any], folder: str, before: str, path: Path) -> dict[str, Tensor]:
    """The tensors of one folder of the archive by their names."""
    if _bytes(files, "byteorder", path) != sys.byteorder.encode():
        raise DataError(path, "another order of bytes", sys.byteorder, _REMEDY)
    config = _json(files, f"data/{folder}/model_{folder}_config.json", path, GraphConfig).config
    tensors = {}
    for name, payload in config.items():
        if not payload.path_name.startswith(before):
            raise DataError(path, f"an object {payload.path_name} that is no tensor", "tensors alone", _REMEDY)
        data = _bytes(files, f"data/{folder}/{payload.path_name}", path)
        tensors[name] = _tensor(data, payload.tensor_meta, f"{path}: {name}")
    return tensors


def _tensor(data: bytes, meta: GraphMeta, where: str) -> Tensor:
    """A tensor of its bytes, within them."""
    kind = _DTYPES[meta.dtype]
    sizes: list[int] = [int(length.as_int) for length in meta.sizes]
    strides = [int(length.as_int) for length in meta.strides]
    offset, count = meta.storage_offset.as_int, len(data) // kind.itemsize
    reach = offset + sum((n - 1) * stride for n, stride in zip(sizes, strides, strict=False)) + 1
    size: int = prod(sizes)
    if len(sizes) != len(strides) or (size and not size <= reach <= count):
        raise DataError(where, f"{len(data)} bytes for a tensor of {sizes}", "all of it", _REMEDY)
    if not size:
        return torch.empty(sizes, dtype=kind)
    tensor = torch.frombuffer(bytearray(data), dtype=kind, count=count).as_strided(sizes, strides, offset)
    if not tensor.isfinite().all():
        raise DataError(where, "values that are not finite", "finite ones", _REMEDY)
    return tensor


def _check(graph: Graph, path: Path) -> None:
    """Raises DataError for an operator that is not on the list, at any depth."""
    for node in graph.nodes:
        if node.target != _AUTOCAST:
            _operator(node.target, path)
        for given in node.inputs:
            if given.arg.as_graph is not None:
                _check(given.arg.as_graph, path)


@contextmanager
def _computing(path: Path) -> Iterator[None]:
    """Within it, what an operator refuses is a DataError."""
    try:
        yield
    except (RuntimeError, TypeError, ValueError, IndexError, OverflowError, KeyError) as error:
        if isinstance(error, TmcaError):
            raise
        reason = str(error).partition("\n")[0][:120]
        raise DataError(path, f"a graph that cannot be computed ({reason})", "that of a decoder", _REMEDY) from None


def _outputs(graph: Graph, tensors: dict[str, Tensor], path: Path) -> list[Tensor]:
    """The tensors that come out of a graph; what is not needed any more is let go of."""
    wanted = [name for output in graph.outputs for name in output.names]
    last = {name: place for place, node in enumerate(graph.nodes) for name in _needed(node)}
    held = sum(_size(tensor) for tensor in tensors.values())
    for place, node in enumerate(graph.nodes):
        made = _made(node, tensors, path)
        held += sum(map(_size, made.values()))
        if held > LARGEST:
            raise DataError(
                path, f"a graph that needs {held / 2**30:.0f} GB", f"{LARGEST // 2**30} GB at most", _REMEDY
            )
        tensors.update(made)
        for name in {*_needed(node), *made} - {*wanted}:
            if last.get(name, place) == place:
                held -= _size(tensors.pop(name))
    return [tensors[name] for name in wanted]


def _size(tensor: Tensor) -> int:
    return tensor.numel() * tensor.element_size()


def _needed(node: GraphNode) -> list[str]:
    return [name for given in node.inputs for name in given.arg.names]


def _made(node: GraphNode, tensors: Mapping[str, Tensor], path: Path) -> dict[str, Tensor]:
    """The tensors of one node by their names."""
    if node.target == _AUTOCAST:
        result = _autocast(node, tensors, path)
    else:
        operator = _operator(node.target, path)
        plain = [_value(one.arg, tensors) for one in node.inputs if one.kind == 1]
        named = {one.name: _value(one.arg, tensors) for one in node.inputs if one.kind == 2}
        if "device" in named and next(iter(tensors.values())).is_meta:
            named["device"] = torch.device("meta")
        result = operator(*plain, **named)
    names = [name for output in node.outputs for name in output.names]
    values = [result] if isinstance(result, Tensor) else list(result or [])
    return dict(zip(names, values, strict=True))


def _operator(target: str, path: Path) -> Any:
    """An operator on the list."""
    match = _TARGET.fullmatch(target)
    packet = getattr(torch.ops.aten, match[1]) if match and match[1] in OPERATORS else None
    if match is None or packet is None or match[2] not in packet.overloads() or match[2] == "out":
        raise DataError(path, f"the operator {target[:80]!r}", "operators of a decoder", _REMEDY)
    return getattr(packet, match[2])


def _autocast(node: GraphNode, tensors: Mapping[str, Tensor], path: Path) -> list[Tensor]:
    """A graph within the graph, computed in the types that it names."""
    _, dtype, enabled, cache, part, *given = (one.arg for one in node.inputs)
    if part.as_graph is None or dtype.as_scalar_type is None:
        raise DataError(path, f"{_AUTOCAST} without a graph", "one", _REMEDY)
    names = [name for one in part.as_graph.inputs for name in one.names]
    inside = {name: tensors[one.names[0]] for name, one in zip(names, given, strict=True)}
    with torch.autocast("cpu", _DTYPES[dtype.as_scalar_type], bool(enabled.as_bool), bool(cache.as_bool)):
        return _outputs(part.as_graph, inside, path)


def _value(argument: GraphArgument, tensors: Mapping[str, Tensor]) -> Any:
    """What an operator is given."""
    (kind,) = argument.model_fields_set
    value = getattr(argument, kind)
    if kind == "as_tensor":
        return tensors[value.name]
    if kind == "as_tensors":
        return [tensors[one.name] for one in value]
    if kind in _KINDS:
        return _KINDS[kind](value)
    return list(value) if isinstance(value, tuple) else value


_KINDS: dict[str, Callable[[Any], Any]] = {
    "as_none": lambda value: None,
    "as_scalar_type": _DTYPES.__getitem__,
    "as_memory_format": _FORMATS.__getitem__,
    "as_layout": lambda value: torch.strided,
    "as_device": lambda value: torch.device("cpu"),
}
