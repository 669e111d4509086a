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
# # Radar and radio in one signal
#
# You learn to describe a radar and a radio link that share a band, to recover targets and paths from what one receiver
# hears, and to judge the result. Reading takes ten minutes, running about ten seconds.
#
# The receiver knows neither the radar's pulse nor the messages, neither the targets nor the paths. It knows only that
# each signal is an unknown mix of a few known waveforms. This is dual blind deconvolution, `tmca.dbd`.

# %% [markdown]
# ## A scene
#
# Two cars before a radar at 77 GHz, and a roadside unit that reaches the receiver on two paths. Distances are in
# metres, velocities in metres a second, away from the receiver positive.

# %%
import warnings

from tmca import dbd

scenario = dbd.Scenario(
    targets=[
        dbd.Target(range_m=60, velocity_m_s=10),
        dbd.Target(range_m=150, velocity_m_s=-35, gain=0.7),
    ],
    paths=[
        dbd.Path(length_m=90, velocity_m_s=5),
        dbd.Path(length_m=240, velocity_m_s=-12),
    ],
    snr_db=20,
)
scenario

# %% [markdown]
# ## What the receiver gets
#
# `draw` draws the waveforms and the messages, `receive` computes in the time domain what arrives. Both signals lie upon
# each other in all 17 pulses.

# %%
problem = scenario.draw(seed=1).receive()
problem

# %%
problem.plot()

# %% [markdown]
# ## Recover
#
# `solve` finds both channels and both signals at once, off any grid.

# %%
recovery = dbd.solve(problem)
recovery

# %%
table = recovery.to_pandas().set_index("name")
table[["range_m", "length_m", "velocity_m_s", "velocity_m_s_std", "power_db"]].round(2)

# %% [markdown]
# Targets have a range, paths a length. The weaker car has −3 dB. Columns that end in `_std` are one standard deviation:
# the Cramér–Rao bound at the noise of the samples. The table has them for range and length too.

# %% [markdown]
# ## Look at it
#
# A row for each signal. Left is the matched filter of the estimated waveform, right the dual polynomial: it is one where
# there is a target or a path. Circles are the truth, crosses the estimate.

# %% tags=["picture"]
recovery.plot()

# %% [markdown]
# ## How near to the truth?

# %%
score = recovery.score()
print(f"largest error of a normalised delay or Doppler: {score.max_error:.1e}")
print(f"found: {recovery.found}, unexplained: {100 * recovery.unexplained:.1f} %")

# %% [markdown]
# ## When something is wrong
#
# A common mistake is I and Q in the wrong order: every sample is the conjugate of what it should be. With enough paths
# nearly everything can be fitted, so the share that stays unexplained says little alone. `found` is False where the
# paths explain the samples no better than any basis would, and `doubt` says why.

# %%
small = dbd.simulate(M=13, P=9, J=3, targets=2, paths=2, seed=1, snr_db=20)
swapped = dbd.Problem(small.y.conj(), small.sources, small.sigma)
with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # the warning has the words of `doubt`
    doubtful = dbd.solve(swapped)
print(f"found: {doubtful.found}, unexplained: {100 * doubtful.unexplained:.1f} %")
print(doubtful.doubt)

# %% [markdown]
# ## Keep it
#
# The table as CSV and the figure as PDF, in the current folder.

# %%
table.to_csv("targets.csv")
recovery.plot().savefig("recovery.pdf")
print("targets.csv and recovery.pdf are in the current folder")

# %% [markdown]
# ## Where to go
#
# - [Dual blind deconvolution](../dbd.md): model, solvers, certificates, samples of your own.
# - [What was measured](../results/dbd.md): when it succeeds, in which noise, and at what cost.
# - `tmca dbd simulate --scenario road --out road.nc` and `tmca dbd solve road.nc` do the same from the command line.
