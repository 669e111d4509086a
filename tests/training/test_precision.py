"""Half precision is chosen where the device computes it, and only there."""

import pytest
import torch

from tests.training import tiny
from tmca.decoders import Weights
from tmca.training.coded_system import CodedSystem
from tmca.training.engine import choose_precision


@pytest.mark.parametrize(
    ("found", "chosen"),
    [
        ({"avx2": True, "avx512_bf16": False, "amx_bf16": False}, "32-true"),
        ({"avx2": True, "avx512_bf16": True}, "bf16-mixed"),
        ({"amx_bf16": True, "amx_int8": True}, "bf16-mixed"),
        ({"architecture": "aarch64", "arm_bf16": True}, "bf16-mixed"),
        ({"architecture": "aarch64", "l2_cache_size": 1 << 20}, "32-true"),
    ],
)
def test_the_processor_decides(monkeypatch, found, chosen):
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: found)
    assert choose_precision("auto", "cpu") == chosen


@pytest.mark.parametrize("has", [True, False])
def test_a_graphics_card_decides_where_it_trains(monkeypatch, has):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda including_emulation=True: has)
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"amx_bf16": not has})
    assert choose_precision("auto", "auto") == choose_precision("auto", "cuda") != choose_precision("auto", "cpu")
    assert choose_precision("auto", "cuda") == ("bf16-mixed" if has else "32-true")


@pytest.mark.parametrize("asked", ["32-true", "bf16-mixed"])
def test_what_is_asked_for_is_used(monkeypatch, asked):
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"amx_bf16": asked == "32-true"})
    assert choose_precision(asked, "cpu") == asked


def test_weights_say_which_precision_it_was(tmp_path, monkeypatch):
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx2": True})
    found = tiny.train(tmp_path / "run", **{"precision": "auto", "optimiser.steps": 2})
    assert Weights.load(found.weights).card["training"]["precision"] == "32-true"
    again = tiny.train(tmp_path / "run", **{"precision": "auto", "optimiser.steps": 2})  # still the same run
    assert again.steps == 2


@pytest.mark.parametrize("precision", ["32-true", "bf16-mixed"])
def test_scenes_and_their_truth_are_never_rounded(tmp_path, monkeypatch, precision):
    met, recorded = [], CodedSystem.forward

    def forward(system, patches, *drawn):
        met.extend(values for patch in patches for values in (patch.scene, patch.truth))
        layer = torch.nn.functional.linear(torch.eye(2), torch.eye(2))
        assert layer.dtype == (torch.bfloat16 if precision == "bf16-mixed" else torch.float32)
        return recorded(system, patches, *drawn)

    monkeypatch.setattr(CodedSystem, "forward", forward)
    tiny.train(tmp_path / "run", **{"precision": precision, "optimiser.steps": 2})
    assert len(met) == 16
    assert all(values.dtype == torch.float32 for values in met)
    assert any(not values.bfloat16().float().equal(values) for values in met)
