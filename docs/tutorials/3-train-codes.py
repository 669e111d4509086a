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
# # Train codes and a decoder together
#
# You learn to start a training, to stop it and go on, and to use what it learned. Reading takes ten minutes, running
# about twenty seconds, because the run is tiny; the last part says what real training takes.
#
# Mask and shutter are binary. They learn all the same: the derivative is that of a smooth step, and the network that
# decodes the snapshots learns along with them.

# %% [markdown]
# ## A run and its settings
#
# Scenes to learn from and scenes for validation are files, or names of rendered scenes. The preset `quick` is for
# minutes. Here everything is smaller still: patches of 32 pixels, two slots, 20 steps, and a first estimate that needs
# no prior (`tikhonov`: least squares with smooth bands).

# %%
import tmca

run = {
    "scenes": ["astronaut"],
    "validation": ["rocket"],
    "preset": "quick",
    "settings": {
        "optimiser.steps": 20,
        "camera.slots": 2,
        "camera.period": 16,
        "data.patch": 32,
        "data.batch": 1,
        "decoder.start": "tikhonov",
        "decoder.stages": 1,
        "validate_every": 5,
        "checkpoint_every": 4,
    },
    "out": "tiny_run",
}

# %% [markdown]
# ## Stop it
#
# A run can end at any moment: the stop button, Ctrl-C, a power cut. Here a function stops it after 9 steps. It is told
# of every step; without it a bar is shown.


# %%
def stop_at_9(done, steps, text):
    if done == 9:
        raise KeyboardInterrupt


try:
    tmca.train("spectral", progress=stop_at_9, **run)
except KeyboardInterrupt:
    print("stopped; the folder tiny_run has the checkpoint of step 8")

# %% [markdown]
# ## Go on
#
# The same call goes on from the last checkpoint. The result is the same to the last bit as that of a run that was never
# stopped.

# %%
trained = tmca.train("spectral", **run)
trained

# %% tags=["picture"]
trained.plot()

# %% [markdown]
# ## Use it
#
# The weights hold codes and network. `camera_for` gives the camera with these codes for any size of scene and any
# sensor, and the decoder `network` reads the rest.

# %% tags=["picture"]
scene = tmca.read("coffee", size=(64, 64))
sensor = tmca.Sensor(read_noise=0.01)
snapshot = tmca.simulate(scene, trained.camera_for((64, 64), sensor=sensor))
snapshot.camera.plot()

# %%
estimates = {
    "its first estimate, tikhonov": tmca.reconstruct(snapshot, "tikhonov"),
    "network of this run": tmca.reconstruct(snapshot, "network", weights=trained.weights),
    "lmmse, through the same codes": tmca.reconstruct(snapshot, "lmmse"),
}
for name, estimate in estimates.items():
    print(f"{name}: {tmca.evaluate(estimate, scene)['psnr']:.1f} dB")

# %% [markdown]
# The validation rises, and the codes change. But 20 patches teach the network next to nothing: it is where it started,
# far from the linear estimate (`lmmse`), which knows the statistics of natural scenes.

# %% [markdown]
# ## What real training takes
#
# - `"decoder.start": "lmmse"` begins where the linear estimate ends. It is the preset's choice, and slower.
# - 300 steps with 16 patches of 64 pixels take about ten minutes on two cores. On real scenes they gained 1.4 to 2.4 dB
#   over `lmmse` through the same codes where there was noise, and 0.3 to 1.2 dB where there was none.
# - Scenes like yours, some tens at least. One photograph is enough for a demonstration only.
# - Codes start better from `tmca design` than at random: `"codes.start": "my_design/codes.nc"`.
#
# The weights that come with tmca were trained like that. They are called `default`:

# %%
weights = tmca.decoders.Weights.find("default")
snapshot = tmca.simulate(scene, weights.camera_for((64, 64), sensor=sensor))
estimates = {
    "shipped network": tmca.reconstruct(snapshot, "network", weights="default"),
    "lmmse, through the same codes": tmca.reconstruct(snapshot, "lmmse"),
}
for name, estimate in estimates.items():
    print(f"{name}: {tmca.evaluate(estimate, scene)['psnr']:.1f} dB")

# %% [markdown]
# ## Where to go
#
# - [Training](../training.md): presets, networks, codes, what it gains; [every setting](../training-settings.md).
# - [Fine-tuning on captures](../fine-tuning.md): a trained decoder learns on from a real bench.
# - [My bench from zero](4-my-bench.py): codes on a device, captures, calibration.
