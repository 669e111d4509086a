# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # My bench from zero
#
# You learn the way from codes to patterns on devices, to captures, to a calibration, and to a reconstruction that uses
# it. Reading takes ten minutes, running about fifteen seconds. No hardware is needed: the bench is simulated, and it is
# not quite where it should be.

# %% [markdown]
# ## A camera as it is drawn
#
# A spectral camera with two slots. Its snapshot file is the drawing: it holds codes, optics and sensor. All files of
# this tutorial go into the current folder.

# %%
import tmca
from tmca import lab

scene = tmca.read("coffee", size=(64, 64))
sensor = tmca.Sensor(full_well=30_000, read_noise_electrons=5)
drawn = tmca.simulate(scene, tmca.SpectralCamera(slots=2, shutter="one-hot", sensor=sensor))
print(drawn.save("drawn.nc", overwrite=True))

# %% [markdown]
# ## Patterns for the devices
#
# A DMD shows the aperture, with 4×4 mirrors for a pixel of the code. The sensor codes the exposure of its pixels. The
# folder holds a picture for each device and slot, and a manifest with times and checksums.

# %% tags=["picture"]
devices = ["dli4120", "coded-exposure"]
patterns = lab.export("drawn.nc", devices, "patterns", macro_pixel=4, overwrite=True)
patterns.plot()

# %% [markdown]
# ## The bench
#
# This one is simulated. Its mask is displaced by 0.3 pixels, and nobody is told. A real bench is the same object with
# `device="my_bench.py:MyBench"`, a class of your own. It has the methods `load`, `show` and `capture`, and the attribute
# `saturation`. For the calibration below it also needs `illuminate`, which sets the light:
# [devices](../devices.md). Without it you set the light yourself, step by step:
# [calibration](../calibration.md).

# %%
bench = lab.Bench("patterns", hardware=tmca.cameras.Hardware(misregistration=0.3))
bench

# %% [markdown]
# ## Capture
#
# Every frame is kept as soon as it is there. A capture that was stopped goes on where it was.

# %%
captured = bench.capture("captures", scene)
estimate = tmca.reconstruct(captured)
print(f"as drawn: {tmca.evaluate(estimate, scene)['psnr']:.1f} dB")
estimate.plot(truth=scene)

# %% [markdown]
# A third of a pixel costs that much. The decoder believes in a camera that does not exist.

# %% [markdown]
# ## Calibrate
#
# The bench takes dark frames, even light, exposure series, patterns, slots and single wavelengths. Each step measures
# one thing, and builds on those before it.

# %%
calibration = bench.calibrate("calibration", frames=4, curve="measured")
calibration

# %%
calibration.plot("registration")

# %% [markdown]
# Where does the calibration see the mask? The truth is 0.3 pixels in both directions; columns also have the 6 pixels by
# which the prism moves the light of this step. `quality` is 1 or less where the captures of a step were good;
# lines through all measured shifts of the bands (`curve="measured"`) leave nothing to judge.

# %%
print("rows and columns:", calibration.part("registration").matrix[:, 2].round(2))
for name, step in calibration.about["steps"].items():
    quality = step["residuals"].get("quality")
    print(f"{name:13} quality", "none" if quality is None else f"{quality:.2f}")

# %% [markdown]
# ## Reconstruct with it
#
# The same capture, laid on the camera as it was measured. Nothing is captured again.

# %% tags=["picture"]
calibrated = tmca.reconstruct(lab.calibrated_snapshot(captured, calibration))
print(f"calibrated: {tmca.evaluate(calibrated, scene)['psnr']:.1f} dB")
calibrated.plot(truth=scene)

# %% [markdown]
# ## Keep the calibration
#
# Its name gets the date. `tmca reconstruct snapshot.nc --calibration my_bench` takes the newest one.

# %%
print(calibration.save("my_bench").path)

# %% [markdown]
# ## Where to go
#
# - `tmca new driver my-bench` writes a driver that works, for you to change: [devices](../devices.md).
# - [Calibration](../calibration.md): every step, its captures and its errors.
# - [Benches with faults](../hardware.md): what each fault costs.
