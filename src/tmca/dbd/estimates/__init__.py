"""From lifted atoms to channels and waveforms, in noise too: order, refinement, bounds."""
