"""Bases from waveforms in time against analytic spectra, slow sums and what is read from files."""

import json

import numpy as np
import pytest
from scipy.io import savemat
from scipy.special import fresnel

from tmca.dbd import (
    Chirp,
    Ofdm,
    Problem,
    SampledWaveform,
    Source,
    Units,
    basis_from_waveform,
    load_problem,
    read_recording,
    read_waveforms,
    solve,
    spectra_of_recording,
    waveform_source,
)
from tmca.dbd.files import save_problem
from tmca.dbd.simulation import carriers
from tmca.errors import DataError, SettingError, ShapeError

USEFUL = 3e-6


def fourier_of_chirp(bandwidth, duration, frequencies):
    """∫ exp(jπ k (t − T/2)²) exp(−j2πft) dt over the pulse, by Fresnel integrals."""
    rate, f = bandwidth / duration, carriers(frequencies) / USEFUL
    ends = [np.sqrt(2 * abs(rate)) * (edge - np.sign(rate) * f / abs(rate)) for edge in (-duration / 2, duration / 2)]
    (low_s, low_c), (high_s, high_c) = map(fresnel, ends)
    inside = (high_c - low_c) + 1j * np.sign(rate) * (high_s - low_s)
    return inside * np.exp(-1j * np.pi * f**2 / rate) * np.exp(-1j * np.pi * f * duration) / np.sqrt(2 * abs(rate))


@pytest.mark.parametrize("bandwidth", [8e6, -5e6])
@pytest.mark.parametrize("frequencies", [31, 24])
def test_a_chirp_has_its_analytic_spectrum(bandwidth, frequencies):
    rows = Chirp(bandwidth, 1e-6).rows(4, frequencies, USEFUL)
    truth = fourier_of_chirp(bandwidth, 1e-6, frequencies)
    assert rows.shape == (frequencies, 1)
    np.testing.assert_allclose(rows[:, 0], truth / np.sqrt(np.mean(np.abs(truth) ** 2)), atol=5e-3)


def test_pieces_of_a_chirp_add_up_to_it():
    whole, parts = (Chirp(8e6, 1e-6, pieces).rows(1, 31, USEFUL) for pieces in (1, 4))
    total = parts.sum(axis=1)
    np.testing.assert_allclose(total / np.sqrt(np.mean(np.abs(total) ** 2)), whole[:, 0], atol=2e-3)


def test_a_basis_is_a_slow_sum():
    rng = np.random.default_rng(1)
    samples = rng.standard_normal((2, 20)) + 1j * rng.standard_normal((2, 20))
    rows = basis_from_waveform(samples, 6, USEFUL, 10e6, start_s=0.2e-6)
    slow = np.zeros((6, 2), complex)
    for row, n in enumerate((-3, -2, -1, 0, 1, 2)):
        for column in range(2):
            for k in range(20):
                slow[row, column] += samples[column, k] * np.exp(-2j * np.pi * n * (0.2e-6 + k / 10e6) / USEFUL)
    np.testing.assert_allclose(rows, slow / np.sqrt(np.mean(np.abs(slow) ** 2)), atol=1e-12)


@pytest.mark.parametrize("subcarriers", [9, 8])
def test_subcarriers_are_orthogonal_whatever_the_delay_within_the_prefix(subcarriers):
    grid, rate = Ofdm(subcarriers, unknowns=2, prefix_s=1e-6, seed=3), 16e6
    rows = grid.rows(3, 11, USEFUL)
    sent = grid.samples(3, USEFUL, rate)
    for late in (0, 7, 16):  # samples
        begin = round(1e-6 * rate) - late
        heard = basis_from_waveform(sent[..., begin : begin + round(USEFUL * rate)], 11, USEFUL, rate)
        ramp = np.exp(-2j * np.pi * carriers(11) * late / rate / USEFUL)
        scale = np.sqrt(np.mean(np.abs(rows) ** 2))
        np.testing.assert_allclose(heard, rows * ramp[:, None] / scale, atol=1e-9)


def test_a_recording_in_time_gives_the_targets_of_a_known_chirp():
    chirp, rate, prf, pulses = Chirp(9e6, 0.5e-6), 160e6, 2e5, 6
    times = np.arange(round(pulses / prf * rate)) / rate
    recording = np.zeros(len(times), complex)
    for delay, doppler, gain in ((0.4e-6, 3e4, 1.0), (1.3e-6, -5e4, 0.7j)):
        for pulse in range(pulses):
            since = times - pulse / prf - delay
            inside = (since >= 0) & (since < 0.5e-6)
            phase = np.pi * 9e6 / 0.5e-6 * (since[inside] - 0.25e-6) ** 2 - 2 * np.pi * doppler * pulse / prf
            recording[inside] += gain * np.exp(1j * phase)
    y = spectra_of_recording(recording, 31, USEFUL, rate, prf)
    assert y.shape == (pulses, 31)
    radar = waveform_source("radar", chirp, pulses, 31, USEFUL)
    found = solve(Problem(y, (radar,), sigma=0.02 * np.abs(y).max(), units=Units(USEFUL, prf)), certify=False)
    frame = found.to_pandas()
    np.testing.assert_allclose(frame.delay_s, [0.4e-6, 1.3e-6], atol=5e-9)
    np.testing.assert_allclose(frame.doppler_hz, [3e4, -5e4], atol=600)


PULSE = (np.arange(12) - 6) / 16 + 1j * (np.arange(12) % 5 - 2) / 8


def sigmf(folder, kind, values, about=None, frequency=77e9):
    """A pair of files."""
    head = {"core:datatype": kind, "core:sample_rate": 5e6, "core:version": "1.2.0"} | (about or {})
    captures = [{"core:sample_start": 0, "core:frequency": frequency}]
    (folder / "p.sigmf-meta").write_text(json.dumps({"global": head, "captures": captures, "annotations": []}))
    values.tofile(folder / "p.sigmf-data")
    return folder / "p.sigmf-meta"


def interleaved(values):
    return np.stack([values.real, values.imag], -1).ravel()


@pytest.mark.parametrize(
    ("kind", "stored"),
    [
        ("cf32_le", interleaved(PULSE).astype("<f4")),
        ("cf64_be", interleaved(PULSE).astype(">f8")),
        ("ci16_le", (interleaved(PULSE) * 2**15).astype("<i2")),
        ("ci8", (interleaved(PULSE) * 2**7).astype("i1")),
        ("cu8", (interleaved(PULSE) * 2**7 + 2**7).astype("u1")),
    ],
)
def test_sigmf_of_every_type_is_read_as_it_was_written(tmp_path, kind, stored):
    recorded = read_recording(sigmf(tmp_path, kind, stored))
    np.testing.assert_allclose(recorded.samples, PULSE, atol=1e-7)
    assert recorded.sample_rate_hz == 5e6


def test_sigmf_of_the_baseband_is_read(tmp_path):
    file = sigmf(tmp_path, "cf32_le", interleaved(PULSE).astype("<f4"), frequency=0)
    np.testing.assert_allclose(read_recording(file).samples, PULSE, atol=1e-7)


def test_the_first_of_several_channels_is_read(tmp_path):
    both = np.stack([PULSE, 2 * PULSE], axis=1).ravel()
    file = sigmf(tmp_path, "cf32_le", interleaved(both).astype("<f4"), {"core:num_channels": 2})
    np.testing.assert_allclose(read_recording(file).samples, PULSE, atol=1e-7)


def test_matlab_and_numpy_files(tmp_path):
    import h5py

    np.savez(tmp_path / "p.npz", pulse=PULSE)
    np.save(tmp_path / "p.npy", PULSE)
    savemat(tmp_path / "p.mat", {"pulse": PULSE[:, None], "note": "text"})
    with h5py.File(tmp_path / "new.mat", "w") as file:
        pairs = np.array(list(zip(PULSE.real, PULSE.imag, strict=True)), [("real", "f8"), ("imag", "f8")])
        file["pulse"] = pairs[None]
    for name in ("p.npz", "p.npy", "p.mat", "new.mat"):
        np.testing.assert_allclose(read_recording(tmp_path / name).samples, PULSE)


@pytest.mark.parametrize(
    ("meta", "said"),
    [
        ("{", "unreadable or truncated SigMF description"),
        ("[]", "core:datatype"),
        ('{"global": {"core:datatype": "cx7"}}', "datatype 'cx7'"),
        ('{"global": {"core:datatype": "cf32_le", "core:sample_rate": -1}}', "core:sample_rate"),
    ],
)
def test_bad_descriptions_are_refused(tmp_path, meta, said):
    (tmp_path / "p.sigmf-meta").write_text(meta)
    np.zeros(8, "<f4").tofile(tmp_path / "p.sigmf-data")
    with pytest.raises(DataError, match=said):
        read_recording(tmp_path / "p.sigmf-meta")


def test_waveforms_of_the_command_line_and_of_yaml_are_the_same(tmp_path):
    (tmp_path / "w.yaml").write_text("radar: {kind: chirp, bandwidth_hz: 8e6, duration_s: 1.0e-6}\n")
    assert read_waveforms("radar=chirp:bandwidth=8e6,duration=1e-6") == {"radar": Chirp(8e6, 1e-6)}
    assert read_waveforms(str(tmp_path / "w.yaml")) == {"radar": Chirp(8e6, 1e-6)}
    assert read_waveforms("link=ofdm:subcarriers=9,unknowns=2,shared=yes") == {"link": Ofdm(9, 2, True)}
    (tmp_path / "s.yaml").write_text("radar: {kind: samples, file: p.npy}\n")
    assert read_waveforms(str(tmp_path / "s.yaml"))["radar"].file == tmp_path / "p.npy"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("radar=tone:f=1", "one of chirp, ofdm, samples"),
        ("radar=chirp:bandwidth=8e6", "duration"),
        ("radar=chirp:bandwidth=8e6,duration=1e-6,colour=red", "found colour=, expected bandwidth, duration"),
        ("radar=chirp:bandwidth=8e6,durations=1e-6", "did you mean duration?"),
        ("radar=chirp:bandwidth=0,duration=1e-6", "bandwidth of a chirp"),
        ("link=ofdm:subcarriers=3,unknowns=4", "fewer unknowns"),
        ("nowhere.yaml", "no such file"),
    ],
)
def test_bad_waveforms_are_refused(given, said):
    with pytest.raises((SettingError, DataError), match=said):
        read_waveforms(given)


def test_a_missing_setting_or_name_is_said_in_words():
    with pytest.raises(SettingError) as raised:
        read_waveforms("radar=chirp:duration=1e-6")
    assert str(raised.value) == "waveform radar: found no bandwidth=, expected bandwidth, duration, pieces"
    with pytest.raises(SettingError, match="without a NAME, expected NAME=KIND"):
        read_waveforms("=chirp:bandwidth=8e6,duration=1e-6")


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"count": 0}, "count of samples: found 0, expected a whole number, 1 or more"),
        ({"count": 1.5}, "count of samples: found 1.5"),
        ({"start_s": float("nan")}, "start of samples: found nan"),
        ({"sample_rate_hz": 0.0}, "sample rate of samples: found 0 Hz, expected above 0 Hz"),
    ],
)
def test_settings_of_samples_are_checked(settings, said):
    with pytest.raises(SettingError, match=said):
        SampledWaveform("p.npy", **settings)


def test_bad_samples_are_refused():
    with pytest.raises(ShapeError):
        basis_from_waveform(np.ones((1, 1, 1, 4)), 5, USEFUL, 1e7)
    with pytest.raises(SettingError, match="only zeros"):
        basis_from_waveform(np.zeros(8), 5, USEFUL, 1e7)
    with pytest.raises(SettingError, match="cut the samples to one pulse"):
        basis_from_waveform(np.ones(80), 5, USEFUL, 1e7)
    with pytest.raises(SettingError, match="cannot tell them apart"):
        basis_from_waveform(np.ones(8), 31, USEFUL, 1e6)


def test_samples_without_a_basis_take_a_waveform(tmp_path):
    waveforms = read_waveforms("radar=chirp:bandwidth=9e6,duration=5e-7")
    radar = waveform_source("radar", waveforms["radar"], 4, 21, USEFUL)
    ramp = np.exp(-2j * np.pi * carriers(21) * 0.3)
    np.savez(tmp_path / "y.npz", y=radar.rows[..., 0] * ramp, delay_s=USEFUL, doppler_hz=2e5, sigma=0.0)
    found = solve(load_problem(tmp_path / "y.npz", waveforms), certify=False)
    np.testing.assert_allclose(found["radar"].points[:, 0], 0.3, atol=1e-9)
    np.savez(tmp_path / "bare.npz", y=radar.rows[..., 0])
    with pytest.raises(SettingError, match="known useful time"):
        load_problem(tmp_path / "bare.npz", waveforms)
    assert isinstance(found.problem.sources[0], Source)


@pytest.mark.parametrize("name", ["rdar", "radars", "radar 2", "communications"])
@pytest.mark.parametrize("suffix", ["npz", "nc"])
def test_a_name_that_is_nearly_one_of_the_bases_is_refused(tmp_path, suffix, name):
    waveforms = read_waveforms(f"{name}=chirp:bandwidth=9e6,duration=5e-7")
    radar, file = waveform_source("radar", Chirp(9e6, 5e-7), 4, 21, USEFUL), tmp_path / f"y.{suffix}"
    if suffix == "npz":
        np.savez(file, y=radar.rows[..., 0], basis_radar=radar.rows[0], delay_s=USEFUL, doppler_hz=2e5)
    else:
        save_problem(Problem(radar.rows[..., 0], (radar,), units=Units(USEFUL, 2e5)), file)
    if name in ("rdar", "radars"):
        with pytest.raises(SettingError, match=f"waveform: found {name}, expected radar, .*; did you mean radar"):
            load_problem(file, waveforms)
    else:
        assert [one.name for one in load_problem(file, waveforms).sources] == ["radar", name]


@pytest.mark.parametrize(("shape", "said"), [
    ((40,), "a known waveform of 40 samples, the same in every pulse"),
    ((3, 40), "3 unknown waveforms, of which a mix is sent, of 40 samples, the same in every pulse"),
    ((4, 1, 40), "a known waveform of 40 samples in each of 4 pulses"),
])  # fmt: skip
def test_shapes_of_samples_are_told_and_may_change_from_pulse_to_pulse(tmp_path, shape, said):
    samples = np.random.default_rng(0).standard_normal(shape)
    np.save(tmp_path / "w.npy", samples)
    waveform = SampledWaveform(tmp_path / "w.npy", sample_rate_hz=40 / USEFUL)
    assert waveform.taken_as() == said
    source = waveform_source("radar", waveform, 4, 21, USEFUL)
    assert source.messages == 1
    direct = basis_from_waveform(samples, 21, USEFUL, 40 / USEFUL)
    np.testing.assert_allclose(source.rows, np.broadcast_to(direct, source.rows.shape))


def test_waveforms_of_other_pulses_are_refused_and_each_may_have_its_own_mix(tmp_path):
    np.save(tmp_path / "w.npy", np.random.default_rng(0).standard_normal((4, 2, 40)))
    rate = 40 / USEFUL
    with pytest.raises(ShapeError, match="one set of waveforms for each pulse"):
        waveform_source("link", SampledWaveform(tmp_path / "w.npy", sample_rate_hz=rate), 5, 21, USEFUL)
    own = SampledWaveform(tmp_path / "w.npy", sample_rate_hz=rate, shared=False)
    assert waveform_source("link", own, 4, 21, USEFUL).messages == 4
