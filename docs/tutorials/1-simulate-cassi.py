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
# # Simulate CASSI in 20 lines
#
# You learn how one snapshot of a coded aperture camera becomes a cube with 12 bands, and how to say how good it is.
# Reading takes five minutes, running about ten seconds.
#
# CASSI is the classic snapshot spectral camera: a mask of open and closed pixels, a prism and a sensor. The prism moves
# every band by another distance, so that each pixel of the sensor adds up differently coded bands.

# %% [markdown]
# ## A scene
#
# `coffee` is a rendered scene that comes with tmca. A file of your own (`.mat`, ENVI, TIFF, NetCDF, …) is read in the
# same way. The result is an xarray: bands, rows and columns have names, and values are relative to white.

# %%
import tmca

scene = tmca.read("coffee", size=(96, 96))
print(dict(scene.sizes), f"brightest value {float(scene.max()):.2f}")

# %% [markdown]
# ## A camera
#
# One slot and an open shutter make it static: that is CASSI. The sensor reads 20 000 electrons where the scene is white
# and everything is open, with 5 electrons of read noise.

# %%
sensor = tmca.Sensor(full_well=20_000, read_noise_electrons=5)
camera = tmca.SpectralCamera(slots=1, shutter="open", sensor=sensor)
snapshot = tmca.simulate(scene, camera)
snapshot

# %% [markdown]
# The snapshot is wider than the scene, because the prism moves the bands apart. Size and bands of the camera were left
# out, so they came from the scene. The histogram beside it counts the pixels of each level: none should be at 1, full
# scale, where the sensor is full.

# %% tags=["picture"]
snapshot.plot()

# %% [markdown]
# ## Back to a cube
#
# `reconstruct` knows the code, the optics and the noise from the snapshot. Without another wish it takes the best linear
# estimate under a prior of natural scenes (`lmmse`). The prior does not know this scene. Its first use on a computer
# takes some seconds, because the prior is learned; then it is cached.

# %% tags=["picture"]
estimate = tmca.reconstruct(snapshot, uncertainty=True)
estimate.plot(truth=scene)

# %%
merits = tmca.evaluate(estimate, scene)
print(f"PSNR {merits['psnr']:.1f} dB, spectral angle {merits['sam']:.1f} degrees")

# %% [markdown]
# ## How sure is it?
#
# With `uncertainty=True` there is a standard deviation σ for every value. About two thirds (68 %) of the true values
# should be within ±1σ, and 95 % within ±2σ. σ is calibrated on scenes that the prior has not seen; of a scene unlike
# all of them it may be too small.
# It takes some times longer where codes do not repeat (`period=` of the camera), and little longer where they do.

# %%
print(f"{100 * merits['coverage_1s']:.0f} % are within one predicted standard deviation")

# %% [markdown]
# ## Another decoder
#
# `admm-tv` needs no prior, only that pictures are smooth with edges. `tmca decoders` lists all of them.

# %%
smooth = tmca.reconstruct(snapshot, "admm-tv")
print(f"admm-tv: PSNR {tmca.evaluate(smooth, scene)['psnr']:.1f} dB")

# %% [markdown]
# ## Keep it
#
# Both files go into the current folder. The snapshot's file holds everything that is needed to reconstruct it.

# %%
print(snapshot.save("cassi_snapshot.nc", overwrite=True))
print(estimate.save("cassi_estimate.nc", overwrite=True))

# %% [markdown]
# ## Where to go
#
# - [Does multiplexing pay on my sensor?](2-does-multiplexing-pay.py): the same scene through cameras that change their
#   mask within the exposure.
# - [The spectral camera](../spectral.md): its model, units and files.
# - `tmca view cassi_estimate.nc --truth coffee` shows both in a browser.
