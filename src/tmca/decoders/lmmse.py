"""Patch LMMSE: the best linear estimate of the scene under a Gaussian prior of its blocks, without training."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from hashlib import blake2b

import torch
from torch import Tensor

from tmca.errors import SettingError, ShapeError
from tmca.operators.taps import Taps
from tmca.priors.blocks import BlockGrid, BlockModel
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.posterior import BlockPosterior, block_posterior


@dataclass(frozen=True)
class PatchLMMSE:
    prior: GaussianPrior
    stride: tuple[int, int] | None = None
    dtype: torch.dtype = torch.float32
    power: float = 1.0
    window: str = "variance"
    progress: Callable[[float], None] | None = None

    def __call__(self, snapshot: Tensor, taps: Taps, read_noise: float, shot: float = 0.0, uncertainty: bool = False):
        model = BlockModel.of(taps, self.prior.block)
        L, h, w = self.prior.block
        a, b = model.judged
        stride = self.stride or (max(1, h // 2), max(1, (b - a) // 1))
        grid = BlockGrid.cover(model, taps.code.shape[1:], stride)
        rows = self.prior.covariance.to(self.dtype)[model.pixels()]
        mean = self.prior.mean.reshape(-1).to(self.dtype)
        diag = self.prior.covariance.diagonal().to(self.dtype)
        y = snapshot[:, 0].to(self.dtype)
        groups: dict[bytes, list] = {}
        for p in grid.positions:
            key = blake2b(grid.code_windows(taps.code, [p]).numpy().tobytes(), digest_size=16).digest()
            groups.setdefault(key, []).append(p)
        self.stats["groups"] = len(groups); self.stats["blocks"] = len(grid.positions); self.stats["stride"] = stride
        groups = list(groups.values())
        pick = [groups[i][0] for i in torch.linspace(0, len(groups) - 1, 9).long().tolist()]
        post = block_posterior(model, mean, rows, grid.code_windows(taps.code, pick), read_noise, shot)
        var = (diag - post.explained()).mean(0).clamp(min=1e-12).reshape(L, h, w)
        weight = var ** -self.power
        if self.window == "judged":
            weight = torch.zeros(L, h, w, dtype=self.dtype); weight[:, :, a:b] = 1
        if self.window == "jvar":
            z = torch.zeros(L, h, w, dtype=self.dtype); z[:, :, a:b] = 1; weight = z * weight
        if self.window == "rows":
            weight = weight.mean(0, keepdim=True).expand(L, h, w)
        left, right, _, below = grid.padding
        H, W = taps.code.shape[1:]
        num = torch.zeros(len(y), L, H + below, W + left + right, dtype=self.dtype)
        den = torch.zeros(L, H + below, W + left + right, dtype=self.dtype)
        vsum = torch.zeros_like(den)
        chunk = max(1, int(2**28 / (model.measurements * mean.numel() * mean.element_size())))
        for s in range(0, len(groups), chunk):
            part = groups[s : s + chunk]
            post = block_posterior(model, mean, rows, grid.code_windows(taps.code, [g[0] for g in part]), read_noise, shot)
            if uncertainty:
                pv = (diag - post.explained()).clamp(min=0).reshape(-1, L, h, w)
            for u, g in enumerate(part):
                est = mean + post.correction(u, grid.snapshot_windows(y, g))
                for (ty, tx), e in zip(g, est.reshape(len(g), -1, L, h, w)):
                    tx = tx + left
                    num[:, :, ty : ty + h, tx : tx + w] += weight * e
                    den[:, ty : ty + h, tx : tx + w] += weight
                    if uncertainty:
                        vsum[:, ty : ty + h, tx : tx + w] += weight * pv[u]
        out = (num / den)[:, :, :H, left : left + W]
        if uncertainty:
            return out, (vsum / den)[:, :H, left : left + W].sqrt()
        return out

    stats: dict = field(default_factory=dict)
