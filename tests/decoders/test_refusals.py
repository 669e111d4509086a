"""What decoders cannot do: the error says of what kind it is and where."""

from dataclasses import replace

import pytest
import torch
from small_cameras import coded_camera
from test_depth_likelihood import one_window
from test_dictionary import light_field_taps, random_dictionary, sparse
from test_space_time import operator as shuttered
from test_sparse import problem
from test_tikhonov import operator_of, random_snapshots

from tests.operators.test_window_moments import prior_of
from tests.small_scenes import adapted, camera, patches, smooth_scene, snapshot
from tmca.decoders import (
    PatchLikelihood,
    admm_tv,
    batch_omp,
    default_weight,
    lasso_admm,
    pnp_admm,
    total_variation,
    tv_denoiser,
)
from tmca.decoders.kriging import Covariance, Samples
from tmca.decoders.least_squares import tikhonov
from tmca.decoders.pnp import subspace_denoiser
from tmca.decoders.space_time import space_time_dct
from tmca.decoders.tv import tv_prox
from tmca.errors import TmcaError
from tmca.operators.taps import Taps
from tmca.priors import GaussianPrior

NAN = float("nan")
CODED = coded_camera((3, 6, 7))
DARK = torch.zeros(1, *CODED.snapshot_shape)
MATRICES, _, MEASURED = problem()
PRIOR = GaussianPrior.learn([smooth_scene(60, 80, seed=1)], (4, 12))
TAPS = camera("single disperser", 8, 40)
FOUR_BANDS = Taps(torch.ones(4, 2, 9), (0, 1, 2, 3), (0, 0, 0, 0), 4, 9)
VIEWS, ATOMS = light_field_taps(9, 9), random_dictionary()
SLOTS, ODD = shuttered(2, (3, 3)), operator_of("odd")


def light(*shape, level=1.0):
    return torch.full((1, 1, *shape), level, dtype=torch.float64)


def low(height):
    taps = camera("single disperser", height, 40)
    return snapshot(taps, smooth_scene(height, 40)[None]), taps


def likelihood(window=4, prior=None, values=None, **settings):
    made, own, _ = one_window()
    found = PatchLikelihood(own if prior is None else prior(own), made, window, **settings)
    return found(torch.zeros(1, *made.snapshot_shape) if values is None else values)


REFUSED = {
    "admm_tv": (
        lambda weight=0.1, y=DARK, **more: admm_tv(CODED, y, weight, **more),
        [
            ({"weight": -0.1}, "weight"), ({"weight": NAN}, "weight"), ({"max_iterations": 0}, "max_iterations"),
            ({"tolerance": -1e-3}, "tolerance"), ({"rho": 0.0}, "rho"), ({"bounds": (1.0, 0.0)}, "bounds"),
            ({"y": DARK[..., 1:]}, "snapshot"), ({"y": DARK + NAN}, "snapshot"),
            ({"initial": torch.zeros(1, 3, 6, 9)}, "initial"),
        ],
    ),
    "default_weight": (default_weight, [({"noise_sigma": -0.1}, "noise_sigma")]),
    "pnp_admm": (
        lambda denoise=tv_denoiser(), **more: pnp_admm(CODED, DARK, denoise, **more),  # noqa: B008
        [
            ({"noise_sigma": 0.0}, "noise_sigma"), ({"sigma": -1.0}, "sigma"), ({"sigma": (0.1, 0.2)}, "sigma"),
            ({"max_iterations": 0}, "max_iterations"), ({"tolerance": NAN}, "tolerance"),
            ({"denoise": lambda cube, sigma: cube[..., 1:]}, "denoise"),
        ],
    ),
    "subspace_denoiser": (subspace_denoiser, [({"denoise": lambda part, sigma: part, "rank": 0}, "rank")]),
    "tv_prox": (
        lambda weight=1.0, **more: tv_prox(torch.zeros(1, 1, 4, 4), weight, **more),
        [({"weight": -1.0}, "weight"), ({"max_iterations": 0}, "max_iterations")],
    ),
    "total_variation": (total_variation, [({"cube": torch.zeros(4, 4)}, "cube")]),
    "batch_omp": (
        lambda measured=MEASURED, sparsity=3, tolerance=None: batch_omp(MATRICES, measured, sparsity, tolerance),
        [
            ({"measured": MEASURED[..., 1:]}, "measured"), ({"sparsity": 21}, "sparsity"),
            ({"tolerance": -1.0}, "tolerance"),
        ],
    ),
    "lasso_admm": (
        lambda weight=1.0, **more: lasso_admm(MATRICES, MEASURED, weight, **more),
        [({"weight": -0.1}, "weight"), ({"weight": torch.ones(7).double()}, "weight"), ({"free": 45}, "free")],
    ),
    "tikhonov": (
        lambda y=random_snapshots(ODD), **more: tikhonov(ODD, y, **more),  # noqa: B008
        [
            *(({"weight": weight}, "weight") for weight in (0.0, NAN, float("inf"))), ({"iterations": 0}, "iterations"),
            ({"y": random_snapshots(ODD)[..., 1:]}, "snapshot"),
        ],
    ),
    "space_time_dct": (
        lambda y=light(3, 3), last=0.01, **more: space_time_dct(SLOTS, y, last=last, **more),  # noqa: B008
        [
            *(({"last": last}, "threshold") for last in (0.0, NAN, -1.0)), ({"last": 0.2, "first": 0.1}, "threshold"),
            ({"y": light(3, 2)}, "snapshot"), ({"y": light(3, 3, level=NAN)}, "snapshot"),
        ],
    ),
    "kriging": (
        lambda **more: Covariance(**{"length": 1.0, "lifetime": 1.0, "changing": 0.5, "noise": 0.1, **more}),
        [
            ({"length": 0.0}, "length"), ({"lifetime": -1.0}, "lifetime"), ({"noise": NAN}, "noise"),
            ({"changing": 1.5}, "changing"),
        ],
    ),
    "samples": (Samples, [({"points": torch.zeros(2, 3), "values": torch.zeros(2)}, "samples")]),
    "lmmse": (
        lambda y=light(8, 42), taps=TAPS, shot=0.0, **more: patches(PRIOR, **more)(y, taps, 0.0, shot),  # noqa: B008
        [
            ({"y": light(8, 40)}, "snapshot"), ({"shot": -1.0}, "noise"), ({"stride": (0, 3)}, "stride"),
            ({"y": light(2, 9), "taps": FOUR_BANDS}, "prior"),
        ],
    ),
    "lmmse-adapted": (
        lambda height=12, prior=PRIOR, **more: adapted(prior, **more)(*low(height), 0.01),
        [
            ({"height": 3}, "estimate"), ({"prior": replace(PRIOR, moments=PRIOR.covariance)}, "prior"),
        ],
    ),
    "dictionary": (
        lambda y=light(9, 9), taps=VIEWS, noise=0.0, **how: sparse(ATOMS, **how)(y, taps, noise),  # noqa: B008
        [
            ({"y": light(9, 8)}, "snapshot"), ({"noise": -0.1}, "noise"), ({"method": "ksvd"}, "method"),
            ({"taps": Taps(VIEWS.code[:4], (0, 1, 2, 3), (0,) * 4, 4, 9)}, "prior"),
            ({"y": light(9, 10), "taps": Taps(VIEWS.code, tuple(range(9)), (0,) * 8 + (1,), 9, 10)}, "camera"),
            ({"stride": (0, 1)}, "stride"), ({"slack": -1.0}, "slack"),
        ],
    ),
    "likelihood": (
        likelihood,
        [
            ({"window": 5}, "window"), ({"temperature": 0.0}, "temperature"), ({"reach": -1}, "reach"),
            ({"contamination": 1.5}, "contamination"), ({"contamination": NAN}, "contamination"),
            ({"prior": lambda own: replace(own, wavelengths=(480e-9, 600e-9))}, "prior"),
            ({"prior": lambda own: prior_of((6, 6))}, "prior"), ({"values": torch.zeros(1, 1, 4, 4)}, "snapshot"),
        ],
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "changes", "where"), [(name, *row) for name, (_, rows) in REFUSED.items() for row in rows]
)
def test_what_a_decoder_cannot_do_is_refused_by_its_name(name, changes, where):
    with pytest.raises(TmcaError) as caught:
        REFUSED[name][0](**changes)
    assert caught.value.where == where
