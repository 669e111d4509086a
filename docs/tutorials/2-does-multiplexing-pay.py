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
# # Does multiplexing pay on my sensor?
#
# You learn to compare a static camera with time-multiplexed ones under the noise of your own sensor, and to believe the
# answer only as far as it goes. Reading takes ten minutes, running about fifteen seconds.
#
# Time multiplexing tells bands apart better, because the mask changes within the exposure. It also costs light, because
# a closed pixel throws its light away. Which of the two counts more depends on the sensor.

# %% [markdown]
# ## Your sensor
#
# Two numbers of its data sheet matter most: the full well, and the read noise, both in electrons. Change the first entry
# to yours; the others show what happens with less light, and with a worse readout. `bits=12` adds the converter.
#
# The exposure is such that a white scene with everything open just fills the well.

# %%
import pandas as pd

import tmca

sensors = {
    "yours": tmca.Sensor(full_well=10_000, read_noise_electrons=3),
    "much light": tmca.Sensor(full_well=100_000, read_noise_electrons=10),
    "little light": tmca.Sensor(full_well=1_000, read_noise_electrons=3),
    "bad readout": tmca.Sensor(full_well=1_000, read_noise_electrons=30),
}

# %% [markdown]
# ## The cameras
#
# All have the same exposure time and the same optics. `one bucket` opens each pixel in one of four slots. With `two
# buckets` a pixel keeps the light of its closed slots in a second bucket. `burst` is the honest rival: two short frames
# one after the other, from a sensor that is read twice.

# %%
cameras = {
    "static": {"slots": 1, "shutter": "open"},
    "one bucket": {"slots": 4, "shutter": "one-hot"},
    "two buckets": {"slots": 4, "shutter": "balanced", "buckets": 2},
    "burst": {"slots": 2, "shutter": "burst", "buckets": 2},
}

# %% [markdown]
# The two buckets share what the pixel sees: what one does not collect, the other does. For a cube of your own write its
# file in the place of `"coffee"`, such as `tmca.read("my_cube.mat", size=(64, 64))`.

# %%
scene = tmca.read("coffee", size=(64, 64))
two = tmca.SpectralCamera(**cameras["two buckets"], sensor=sensors["yours"])
tmca.simulate(scene, two).plot()

# %% [markdown]
# ## The comparison
#
# Every camera takes the same scene with every sensor. `period=16` lets codes repeat every 16 pixels, which makes the
# decoder faster and changes little.

# %%
rows = {}
for name, sensor in sensors.items():
    for code, settings in cameras.items():
        camera = tmca.SpectralCamera(**settings, period=16, sensor=sensor)
        estimate = tmca.reconstruct(tmca.simulate(scene, camera))
        rows.setdefault(name, {})[code] = tmca.evaluate(estimate, scene)["psnr"]
table = pd.DataFrame(rows).T
table.round(1)

# %% tags=["picture"]
gains = table.sub(table["static"], axis=0).drop(columns="static")
axes = gains.plot.bar(rot=0, ylabel="gain over the static camera (dB)", figsize=(7, 3.2))
axes.axhline(0, color="black", linewidth=0.8)
axes.figure.savefig("gains.png", dpi=120, bbox_inches="tight")

# %% [markdown]
# The picture is also in the current folder, as `gains.png`.

# %% [markdown]
# ## The honest answer

# %%
for name, row in gains.iterrows():
    best = row.drop("burst").idxmax()
    advice = f"{best} gains {row[best]:.1f} dB" if row[best] > 0.1 else "stay static"
    rival = f"; a burst gains {row['burst']:.1f} dB" if row["burst"] > 0.1 else ""
    print(f"{name:13} {advice}{rival}")

# %% [markdown]
# What it says, and what it does not say:
#
# - With **one bucket**, most of the light is lost. Multiplexing then pays only where there is much light.
# - **Two buckets** lose no light, and win where there is enough of it. With little light or a bad readout they lose: two
#   buckets are read, each with its own noise, and each has half of the light.
# - A **burst** is two readings as well, and is 0.4 to 1.0 dB better here than random codes with two buckets, on all but
#   the bad readout. It needs a scene that stands still and a sensor that is fast enough.
# - These are **random** codes. Codes that are searched for the sensor are better, often by more than 1 dB. One scene and
#   one draw of codes are no proof: take several scenes like yours.

# %% [markdown]
# ## Where to go
#
# - `tmca design spectral --full-well 10000 --read-noise-electrons 3 --quick` searches codes for the sensor, and says
#   whether to multiplex at all: [designing codes](../design.md).
# - `tmca study` makes this comparison for your scenes, with a figure for a paper: [studies](../studies.md).
# - [Two buckets](../results/buckets.md) has the numbers for real scenes.
