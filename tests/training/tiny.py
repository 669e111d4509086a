"""A run of seconds on scenes made from their names; as a script, ``python tiny.py FOLDER [name=value …]``."""

import os
import sys
import zlib
from pathlib import Path

import numpy as np
import torch
import yaml

from tmca.data import label
from tmca.training import train as train_camera
from tmca.training import training_settings

DESCRIBED = {
    "camera": {"size": [24, 32], "slots": 2, "period": 8, "learn": "both"},
    "noise": [{"read_noise": 0.01}, {"full_well": 1000, "read_noise_electrons": 2}],
    "decoder": {"kind": "unrolled", "stages": 1, "widths": [6, 8], "blocks": 1, "start": "lmmse"},
    "data": {"train": ["first", "second"], "validation": ["third"], "patch": 16, "batch": 4, "bands": 3, "pool": 20},
    "codes": {"frozen": 0.5},
    "optimiser": {"steps": 8, "loss": "log", "decoder_rate": 0.01},
    "precision": "32-true",
    "validate_every": 4,
    "checkpoint_every": 2,
}


def settings(**changes):
    merged = {
        f"{group}.{name}": v for group, part in DESCRIBED.items() if isinstance(part, dict) for name, v in part.items()
    }
    merged |= {name: value for name, value in DESCRIBED.items() if not isinstance(value, dict)}
    return training_settings("spectral", None, None, merged | changes)


def load(name):
    """A smooth random cube (3, 40, 44) that depends on its name alone."""
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    coarse = torch.from_numpy(rng.random((1, 3, 7, 8), dtype=np.float32))
    fine = torch.nn.functional.interpolate(coarse, size=(40, 44), mode="bicubic").clamp(0, 1)[0]
    cube = label(fine.numpy(), np.array([450e-9, 550e-9, 650e-9]))
    cube.attrs["name"] = name
    return cube


def train(folder, progress=None, load=load, **changes):
    local, every = (int(os.environ.get(name, "1")) for name in ("LOCAL_WORLD_SIZE", "WORLD_SIZE"))
    return train_camera(
        settings(**changes), Path(folder), load, accelerator="cpu", processes=local, nodes=every // local,
        progress=progress,
    )  # fmt: skip


def logged(folder, name):
    """A column of a run's log."""
    rows = [line.split(",") for line in (Path(folder) / "log.csv").read_text().splitlines()]
    return [float(row[rows[0].index(name)]) for row in rows[1:]]


def stop_after(step, error=KeyboardInterrupt):
    """Progress that ends a run after a step."""

    def stop(done, *_):
        if done == step:
            raise error("stopped")

    return stop


if __name__ == "__main__":
    torch.set_num_threads(1)
    told = lambda done, steps, said: print(done, flush=True)  # noqa: E731
    train(sys.argv[1], told, **{name: yaml.safe_load(value) for name, value in (a.split("=") for a in sys.argv[2:])})
