"""The text of docs/results/real.md."""

from __future__ import annotations

from collections.abc import Sequence

from studies.real.records import ControlRow, Geometry, Network, Results
from studies.real.study import SCENES, single_disperser
from studies.tables import Column, table

_SCENE, _DECODER = Column("scene"), Column("decoder")
_PSNR, _SAM = Column("psnr", "PSNR (dB)", ".1f"), Column("sam", "SAM (°)", ".1f")
_REPROJECTION, _WITHHELD = Column("reprojection", "re-projection", ".2%"), Column("withheld", "withheld pixels", ".2%")
_NEIGHBOURS, _SECONDS = Column("neighbours", "mean of neighbours", ".2%"), Column("seconds", "CPU seconds", ".0f")
_SCENE_COLUMNS = (_SCENE, _DECODER, _REPROJECTION, _WITHHELD, _NEIGHBOURS, _SECONDS)
_PAIR_COLUMNS = (_SCENE, Column("one"), Column("other"), _PSNR, _SAM)
_CONTROL_COLUMNS = (_SCENE, _DECODER, _PSNR, _SAM, _WITHHELD, Column("truth", "the truth", ".2%"), _NEIGHBOURS)
_MOVIE_COLUMNS = (
    Column("capture", "code"), _DECODER, _REPROJECTION, Column("withheld", "withheld", ".2%"), _NEIGHBOURS,
    Column("withheld_moving", "withheld, moving", ".2%"), Column("neighbours_moving", "neighbours, moving", ".2%"),
    _SECONDS, Column("agreement_psnr", "agreement (dB)", ".1f"),
)  # fmt: skip


def page(results: Results, name: str) -> str:
    """The page of some results; pictures are named after it."""
    prototype = single_disperser()
    pictures = "\n".join(f"![{prototype.scenes[one]}]({name}_{one}.png)\n" for one in SCENES)
    return f"""# Real captures

`{results["command"]}` at commit {results["commit"]}. [What is measured and how](../real-captures.md).

## Single disperser: three scenes of TSA-Net

{_geometry_text(results["geometry"])}
![Light by displacement, and the mask's place]({name}_geometry.png)

{_scenes_text(results)}
{pictures}
## Per-pixel shutter: wine that is poured

256 slots, each pixel open in one of them; 16 frames of 16 slots each.

{table(results["movies"], _MOVIE_COLUMNS)}
![Frames behind the designed and the random code]({name}_wine.png)
"""


def _scenes_text(results: Results) -> str:
    """Tables of decoders and of their agreement."""
    return f"""\
Errors are shares of the snapshot's norm. *Re-projection* is that of the whole estimate; *withheld pixels* is over 5 %
of the sensor pixels of the 200 brightest rows, which the decoder was not shown; *mean of neighbours* is what the four
pixels around them say without any decoder. CPU seconds are those of one whole capture of 660 × 714 pixels on one
thread.

{table(results["rows"], _SCENE_COLUMNS)}
How far two decoders agree (PSNR over the brightest value, spectral angle where the scene is lit):

{table(results["pairs"], _PAIR_COLUMNS)}
{_network_text(results["network"])}{_control_text(results["control"])}"""


def _control_text(rows: Sequence[ControlRow]) -> str:
    if not rows:
        return ""
    return f"""
### Against a truth

Scenes that are known, behind the middle of this mask and with the noise of {SCENES[0]}. *The truth* is how far it is
from the withheld pixels: their noise.

{table(rows, _CONTROL_COLUMNS)}"""


def _geometry_text(found: Geometry) -> str:
    shares = ", ".join(f"{way} {share:.2f}" for way, share in found["explained"].items())
    scale, shift = found["registration"]["scale"][0], found["registration"]["shift"][0]
    order = "; ".join(
        f"{scene} {both['red far']['withheld']:.2%} against {both['blue far']['withheld']:.2%}"
        for scene, both in found["order"].items()
    )
    return f"""- **The mask lies as its file says.** Its displaced copies explain of the captures' fine structure:
  {shares}.
- **Its image is {scale - 1:.2%} larger along y and {shift:.2f} pixels lower than its file**, with a deviation of
  {found["deviation"]:.2f} pixels from block to block. In register and blurred the copies explain
  {found["explained_registered"]:.2f}.
- **Light falls on displacements from 0 to 54 columns** (the grey range below) and hardly beyond: 28 bands of 2 pixels.
- **Red lies at larger x.** The prism spreads short waves wider. With the bands' widths in the response, ADMM-TV
  predicts withheld pixels with an error of ({"red far against blue far"}): {order}.
"""


def _network_text(found: Network | None) -> str:
    if found is None:
        return ""
    return (
        f"The network: weights `{found['weights']}` ({found['kind']}), from the estimate of {found['start']}, adapted"
        f" to each snapshot in {found['adapt']} steps at most; pixels that it does not learn from say when to stop.\n"
    )
