"""``tmca live``: exposures of a bench, decoded as they come."""

from __future__ import annotations

import statistics
import sys
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Group, Parameter

from tmca.cli.lab.bench import SIMULATED, BenchOptions
from tmca.cli.options.numbers import MaybeOn, MaybeWhole, On, Whole, pair
from tmca.cli.options.output import Json, Overwrite, say
from tmca.cli.stopping import handled
from tmca.errors import SettingError, TmcaError, check_range
from tmca.progress import progress_bar

if TYPE_CHECKING:
    from tmca.decoders import Decoder
    from tmca.lab.live import Shown

app = App(name="live", help="Decode what a bench captures as it comes: in the terminal, in a browser, recorded.")
_BENCH = BenchOptions()
_RECORD = Parameter(group=Group("Recording", sort_key=2))
_EVERY = 2.0
"""Seconds between two lines where nobody watches."""
_RECENT = 1000
"""Estimates over which medians are taken at the end."""


@app.default
def live(
    export: Path,
    /,
    *,
    decoder: Annotated[str | None, Parameter(alias="-d")] = None,
    prior: Path | None = None,
    weights: str | None = None,
    bank: Path | None = None,
    uncertainty: On = True,
    fast: On = False,
    calibration: Path | None = None,
    exposures: MaybeWhole = None,
    rate: float | None = None,
    page: MaybeOn = None,
    port: Whole = 0,
    record: Annotated[Path | None, _RECORD] = None,
    record_estimates: Annotated[bool, _RECORD] = False,
    overwrite: Annotated[Overwrite, _RECORD] = False,
    scene: Annotated[str | None, SIMULATED] = None,
    drift: Annotated[str | None, SIMULATED] = None,
    bench: BenchOptions = _BENCH,
    json: Json = False,
) -> None:
    """Show EXPORT, a folder of `tmca export`, on a bench, exposure after exposure, and decode each as it comes.

    The newest exposure is decoded; those that came meanwhile are dropped, and counted. Ctrl-C ends it. The page in the
    browser is served to this machine alone: estimate, spectrum at a pixel, histogram, latencies.

    Args:
        export: folder of the export.
        decoder: one that `tmca decoders` lists for the camera, or your own as FILE.py:Class or FILE.pt2; the camera's
            usual one without.
        prior: file made by `tmca prior learn`; the rendered scenes' prior without it.
        weights: of a network: a file or run of `tmca train`, default or universal; the decoder is then network.
        bank: file that stores what lmmse computes for camera, noise and prior, for the next start.
        uncertainty: also estimate every pixel's standard deviation.
        fast: lmmse in half or two thirds of the time, some hundredths of a dB below.
        calibration: of the camera, by `tmca calibrate`: a file, or its name without the date for the newest. Every
            exposure is corrected by it, and decoded by the camera as it was measured.
        exposures: how many to decode; until Ctrl-C without.
        rate: most exposures a second; of the simulated bench those of the export without.
        page: serve the page; without, where the packages of `tmca view` are installed.
        port: of the page; any that is free without.
        record: Zarr folder, frame by frame; whatever ends the process, it is whole up to its last frame.
        record_estimates: record estimates beside snapshots.
        overwrite: replace a recording that is there.
        scene: before the simulated bench: a file, or the name of a rendered scene.
        drift: ROWS,COLUMNS by which the scene moves from exposure to exposure.
    """
    from tmca.lab.calibration.file import load_calibration
    from tmca.lab.display.manifest import exposed_whole, read_manifest
    from tmca.lab.live import Exposures, Live, Recording

    bench.check(scene, drift)
    _check_options(bench, scene, exposures, record, record_estimates, overwrite)
    taken, manifest = bench.known(export), read_manifest(export)
    _check_bank(bank, taken.camera)
    device = bench.bench(taken, exposed_whole(manifest), scene, pair(drift, "--drift"))
    how: dict[str, Any] = {"calibration": None if calibration is None else load_calibration(calibration)}
    how |= {"rate": 1 / manifest["exposure_s"] if rate is None and bench.simulated else rate, "timeout": bench.timeout}
    name, made = _decoder(decoder, taken.camera.kind, weights, uncertainty, fast)
    with ExitStack() as opened:
        takers = _served(opened, page, port)
        running = opened.enter_context(Exposures(export, device, taken.camera, **how))
        with progress_bar(f"{name}: preparing") as report:
            prepared = made.prepare(running.camera, prior, report, bank=bank)
        if record is not None:
            more: dict[str, Any] = {"estimates": record_estimates, "scene_shape": made.scene_shape(running.camera)}
            takers.append(opened.enter_context(Recording(record, running.camera, overwrite=overwrite, **more)).add)
        summary, failure = _run(Live(running, prepared), takers, exposures)
    _say(summary, name, record, json)
    _raise_what_ended(failure, summary["interrupted"] and exposures is not None)


def _check_options(
    bench: BenchOptions, scene: str | None, exposures: int | None, record: Path | None, estimates: bool,
    overwrite: bool,
) -> None:  # fmt: skip
    """Refuse what cannot be shown or recorded, before the bench is opened."""
    from tmca.lab.live import check_recording

    if exposures is not None:
        check_range("--exposures", exposures, 1)
    bench.check_scene(scene)
    if record is not None:
        check_recording(record, overwrite)
    elif estimates:
        raise SettingError("--record-estimates", "no --record", "a recording that they are part of", "pass --record")


def _check_bank(bank: Path | None, camera: Any) -> None:
    """Raise SettingError for a bank that no next start could read: noise that is measured at each differs."""
    if bank is not None and not (camera.noise.read or camera.noise.shot):
        found = f"{bank}, of a camera without noise, which is measured anew at every start"
        remedy = "simulate and export with --read-noise, or leave --bank out"
        raise SettingError("--bank", found, "a camera that knows its noise", remedy)


def _decoder(asked: str | None, kind: str, weights: str | None, uncertainty: bool, fast: bool) -> tuple[str, Decoder]:
    """Name of the decoder that is asked for, else of the usual one, and the decoder."""
    from tmca.decoders import decoders_for, make_decoder, usual_decoder
    from tmca.decoders.registry import predicts_deviation
    from tmca.lab.decoder_files import decoder_named

    name = decoder_named(asked) if asked else ("network" if weights else usual_decoder(kind))
    cls = decoders_for(kind, moving=None).get(name)
    settings: dict[str, Any] = {} if weights is None else {"weights": weights}
    settings |= {"fast": True} if fast else {}
    settings |= {"uncertainty": uncertainty} if cls is not None and predicts_deviation(cls) else {}
    return name, make_decoder(name, kind, settings)


def _served(opened: ExitStack, page: bool | None, port: int) -> list[Callable[[Shown], None]]:
    """Serve the page from now on, and say where; what takes estimates for it, nothing without a page.

    Raises:
        SettingError: a page is asked for whose packages are missing, or a port in use.
    """
    import tmca

    if page is None and (absent := tmca.viewer.missing()):
        print(f"no page without {' and '.join(absent)}: pip install 'tmca[view]'", file=sys.stderr)
        return []
    if page is False:
        return []
    served = opened.enter_context(tmca.viewer.LivePage(port))
    print(f"page: {served.address}", file=sys.stderr)
    return [served.show]


def _run(loop: Any, takers: list[Callable[[Shown], None]], most: int | None) -> tuple[dict[str, Any], TmcaError | None]:
    """Give every estimate out until there are enough, the bench ends or fails, or Ctrl-C.

    Returns:
        What was measured until the last estimate, and what failed.
    """
    latencies: dict[str, deque[float]] = defaultdict(lambda: deque(maxlen=_RECENT))
    begun = last = time.monotonic()
    done, interrupted, failure = 0, False, None
    with _terminal() as tell:
        try:
            for shown in loop:
                last = _give(shown, takers, latencies)
                done += 1
                tell(shown)
                if done == most:
                    break
        except KeyboardInterrupt:
            interrupted = True
            handled()
        except TmcaError as error:
            failure = error
    spent = last - begun
    summary = {
        "estimates": done,
        "dropped": loop.dropped,
        "seconds": round(spent, 2),
        "rate": round(done / spent, 2) if done else 0.0,
        "interrupted": interrupted,
        "ms": {stage: round(1e3 * statistics.median(values), 1) for stage, values in latencies.items()},
    }
    return summary, failure


def _raise_what_ended(failure: TmcaError | None, too_early: bool) -> None:
    """Raise what failed, or Ctrl-C before there were as many exposures as were asked for."""
    if failure is not None:
        raise failure
    if too_early:
        raise KeyboardInterrupt


def _give(shown: Shown, takers: list[Callable[[Shown], None]], latencies: dict[str, deque[float]]) -> float:
    """Give an estimate to all that take it, and note how long its stages took.

    Returns:
        When the last of them had it, seconds of the monotonic clock.
    """
    ready = time.monotonic()
    for take in takers:
        take(shown)
    last = time.monotonic()
    for stage, seconds in {**shown.seconds, "give": last - ready}.items():
        latencies[stage].append(seconds)
    return last


def status_line(shown: Shown) -> str:
    """One line on an estimate."""
    stages = ", ".join(f"{stage} {1e3 * seconds:.0f}" for stage, seconds in shown.seconds.items())
    return (
        f"{shown.rate:5.1f} estimates a second · exposure {shown.number} · dropped {shown.dropped} · "
        f"saturated {shown.saturated:.1%} · residual {shown.residual:.1%} · {stages} ms"
    )


@contextmanager
def _terminal() -> Iterator[Callable[[Shown], None]]:
    """Takes estimates: a line that changes; where nobody watches, a line every two seconds."""
    if not sys.stderr.isatty():
        last = [float("-inf")]

        def line(shown: Shown) -> None:
            if time.monotonic() - last[0] >= _EVERY:
                last[0] = time.monotonic()
                print(status_line(shown), file=sys.stderr)

        yield line
        return
    from rich.console import Console
    from rich.live import Live as Changing

    with Changing(console=Console(stderr=True), refresh_per_second=8) as window:
        yield lambda shown: window.update(status_line(shown))


def _say(summary: dict[str, Any], decoder: str, record: Path | None, as_json: bool) -> None:
    stages = ", ".join(f"{stage} {value:g}" for stage, value in summary["ms"].items())
    lines = [
        f"{summary['estimates']} estimates by {decoder} in {summary['seconds']:g} s, {summary['rate']:g} a second, "
        f"{summary['dropped']} exposures dropped",
        f"medians, ms: {stages}" if stages else "no exposure was decoded",
    ]
    if record is not None:
        lines.append(f"recorded: {record}")
    say({**summary, "decoder": decoder, "recording": None if record is None else str(record)}, as_json, *lines)
