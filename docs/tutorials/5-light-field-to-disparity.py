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
# # From a light field to disparity
#
# You learn to take a light field with one snapshot, and to get views, disparity, photographs with another focus, one
# with everything in focus, and points in space from it. Reading takes ten minutes, running about ten seconds.
#
# A coded mask stands a little before the sensor. Light from each direction meets it elsewhere, so that one exposure
# holds 5×5 views of the scene.

# %% [markdown]
# ## A scene with views
#
# `coffee:1` is the first arrangement of a rendered scene. A folder of views, a Lytro picture or a file is read in the
# same way. A light field has axes for the view and for the pixel.

# %%
import tmca

scene = tmca.read("coffee:1", "light-field", views=5, size=(96, 128))
print(dict(scene.sizes))

# %% [markdown]
# ## One snapshot
#
# Four slots, and two buckets in every pixel. The mask stops half of the light; of what passes it the second bucket
# collects what the closed shutter would lose.

# %%
sensor = tmca.Sensor(full_well=30_000, read_noise_electrons=5)
codes = {"slots": 4, "shutter": "balanced", "buckets": 2, "period": 16}
camera = tmca.LightFieldCamera(**codes, sensor=sensor)
snapshot = tmca.simulate(scene, camera)
snapshot.plot()

# %% [markdown]
# ## Views again

# %%
estimate = tmca.reconstruct(snapshot)
print(f"PSNR of all views: {tmca.evaluate(estimate, scene)['psnr']:.1f} dB")
estimate.plot(truth=scene)

# %% [markdown]
# ## Disparity
#
# Near things move more from view to view. `maps` holds the disparity in pixels per view step (positive is nearer than
# the plane in focus), how clear it is, and a photograph with everything in focus.

# %% tags=["picture"]
maps = estimate.maps
maps["disparity"].plot(yincrease=False, cmap="viridis", aspect=1.4, size=3)

# %%
maps["confidence"].plot(yincrease=False, cmap="magma", aspect=1.4, size=3)

# %% [markdown]
# The disparity is matched by plain search. From one snapshot it is rough, and the confidence is only a hint: smooth errors
# of the decoder match well, so it can be high where there is no texture. The rendered scene knows the truth.

# %%
known = tmca.data.rendered_light_field("coffee", views=5, size=(96, 128), seed=1)
error = abs(maps["disparity"].values - known["disparity"].values)
clear = maps["confidence"].values > 0.2
print(f"mean error where it is clear: {error[clear].mean():.2f} px per view step")
print(f"mean error elsewhere: {error[~clear].mean():.2f} px per view step")

# %% [markdown]
# ## Focus after the exposure
#
# From far to near. Each photograph is the mean of all views, moved by the disparity that shall be sharp.

# %% tags=["picture"]
photographs = tmca.refocus(estimate, [-1.5, 0.0, 1.5])
grid = photographs.plot(col="disparity", cmap="gray", yincrease=False, aspect=1.2, size=2.6)
grid.fig.savefig("refocused.png", dpi=120)

# %%
maps["all_in_focus"].plot(yincrease=False, cmap="gray", aspect=1.4, size=3)

# %% [markdown]
# ## Points in space
#
# Disparity becomes distance when the camera is known: its focal length in pixels, the metres between neighbouring views,
# and the distance in focus. Points whose disparity is not clear are left out.

# %%
geometry = {"focal_px": 130, "baseline": 0.03, "focus": 1.5}
cloud = tmca.point_cloud(estimate, least_confidence=0.2, **geometry)
cloud

# %%
cloud.plot()

# %%
cloud.save("coffee.ply", overwrite=True)
print("coffee.ply and refocused.png are in the current folder")

# %% [markdown]
# ## Where to go
#
# - [The light-field camera](../light-field.md): geometry of the mask, files, decoders, what multiplexing gains.
# - `tmca view` lets you drag over the views and move the focus: [the viewer](../viewer.md).
# - [The spectral-depth camera](../spectral-depth.md) measures depth itself, in metres.
