"""Processes that have imported the packages of others and nothing of this one: they begin at once."""

import multiprocessing
from multiprocessing.context import BaseContext

_PACKAGES = (
    "h5netcdf", "hypothesis", "lightning_fabric", "pydantic", "pytest", "scipy.ndimage", "skimage.metrics", "torch",
    "torch._dynamo", "torchmetrics", "xarray",
)  # fmt: skip


def processes() -> BaseContext:
    """Where they come from; one server for all tests of a worker, so they all get the same."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(_PACKAGES))
    return context
