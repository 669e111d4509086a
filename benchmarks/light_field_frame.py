"""Time and memory of a whole light field behind a network: ``python benchmarks/light_field_frame.py``.

The thesis' frame, 5×5 grey views of 480×270 pixels, of a time-multiplexed camera (K = 8), decoded by an untrained
network of the results table or of the `thesis` training preset. One thread, CPU time; the peak is that of the whole
process. Bound: 4 GB.
"""

from __future__ import annotations

import argparse
import json
import resource
import time

import torch

from tmca.cameras import LightFieldCamera
from tmca.decoders import build_network
from tmca.decoders.nets.tiles import CollapsedNetwork
from tmca.evaluation.study import read_study
from tmca.operators import TapOperator
from tmca.priors import find_prior
from tmca.training import TRAININGS

NETWORKS = {name: network.decoder for name, network in read_study("light-field").networks.items()}

BOUND = 4.0
"""GB."""


def settings_of(name: str) -> dict[str, object]:
    """Arguments of ``build_network``."""
    if name == "thesis":
        return dict(TRAININGS["light-field"].presets["thesis"]["decoder"])
    return dict(NETWORKS[name])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--network", choices=(*NETWORKS, "thesis"), default="consistent")
    parser.add_argument("--size", default="270x480")
    parser.add_argument("--views", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    height, width = (int(side) for side in arguments.size.split("x"))
    camera = LightFieldCamera(arguments.views, (height, width), 8, period=16)
    network = build_network(**settings_of(arguments.network), bands=arguments.views**2, views=camera.views).eval()
    prior = find_prior(camera) if network.start == "lmmse" else None
    with torch.no_grad():
        snapshot = camera(torch.rand(1, *camera.scene_shape))
        start = time.process_time()
        CollapsedNetwork(network, TapOperator(camera.taps()), camera.noise, prior)(snapshot)
    seconds, peak = time.process_time() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    found = {"network": arguments.network, "seconds": seconds, "peak_gb": peak, "bound_gb": BOUND}
    told = f"{arguments.network}: {seconds:.1f} s, peak {peak:.2f} GB of {BOUND}"
    print(json.dumps(found) if arguments.json else told)


if __name__ == "__main__":
    main()
